"""Builds a bench from its configuration: plants, nodes and the devices that join them.

>>> bus = embedded_bus()                         # the built-in bench, virtual time
>>> bus = embedded_bus(load_config("bench.toml"))
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import cast

from hil_bench.ability import given_to
from hil_bench.bench.bench import Bench
from hil_bench.bench.compiled import warn_of_edits
from hil_bench.bench.configuration import AxisConfig, BenchConfig, NodeConfig, load_config
from hil_bench.bench.peers import Peers
from hil_bench.bench.power_on import find_short_periods, limit_periods, load_objects
from hil_bench.bench.switchboard import Switchboard
from hil_bench.canopen_device.agenda import Agenda
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.storage import FileStorage
from hil_bench.config.objects import name_object
from hil_bench.config.values import quote
from hil_bench.devices.axis import Axis, Fitting, Measurement
from hil_bench.devices.kinds.bindings import Surroundings, build_script, build_source
from hil_bench.devices.kinds.registry import KINDS
from hil_bench.errors import ConfigError
from hil_bench.outside.transports.embedded import EmbeddedBus
from hil_bench.plants.hydraulic_cylinder.supply_group import Fed, SupplyGroup
from hil_bench.plants.plant import Plant, PlantGroup

logger = logging.getLogger(__name__)


def embedded_bus(config: BenchConfig | None = None) -> EmbeddedBus:
    """Return a bus, the first, with a powered-on bench at its other end, in the caller's thread.

    A tick has passed, in which the devices have booted: their boot-up messages wait to be received,
    and no request is too early. From then on bench time advances only while the caller waits in
    `recv`.

    Args:
        config: the bench; without it the built-in one of one axis.
    """
    config = config or load_config()
    bench = build_bench(config)
    bench.start(0)
    bus = EmbeddedBus(bench.tick, config.tick_ns, medium=bench.medium, fd=config.bus.fd)
    bus.advance(config.tick_ns * 1e-9)
    return bus


def build_bench(config: BenchConfig) -> Bench:
    """Return the bench that `config` describes, not yet powered on."""
    warn_of_edits()
    agenda = Agenda()
    nodes = {node.name: build_node(node, agenda) for node in config.nodes}
    for member in config.nodes:
        protect_tpdos(nodes[member.name], member)
        limit_node_periods(nodes[member.name].object_dictionary, member, config.tick_ns)
    surroundings = Surroundings(
        config.tick_ns,
        config.seed,
        {axis.name: axis for axis in config.axes},
        {axis.name: config.full_scale(axis) for axis in config.axes},
    )
    fittings = {node.name: fit_node(node, nodes[node.name], surroundings) for node in config.nodes}
    built = (part.peers(config, surroundings) for part in config.parts)
    peers: Peers = next((found for found in built if found is not None), Peers())
    parts = {**fittings, **peers.fittings}
    supplies = build_supplies(config)
    plants = build_plants(config, supplies)
    axes = [build_axis(axis, plants[axis.name], list(parts.values())) for axis in config.axes]
    buses = number_buses(config)
    numbers = {node: buses[name] for name, node in nodes.items()}
    bench = Bench(
        axes,
        Switchboard(numbers, agenda),
        steps=config.steps_per_tick,
        fittings=list(fittings.values()),
        sensors=order_sensors(axes, parts, config),
    )
    bench.group([*find_fed(config, supplies), *group_plants(axes, config)])
    devices = {**nodes, **{name: peer.ecu for name, peer in peers.items()}}
    carrier = next((bus.wire for bus in config.buses.values() if bus.wire is not None), None)
    if carrier is not None:
        bench.extend(carrier.medium(config, devices))
    bench.extend(peers)
    for part in config.parts:
        if (extension := part.extension(config, bench)) is not None:
            bench.extend(extension)
    return bench


def find_fed(
    config: BenchConfig, supplies: Sequence[SupplyGroup]
) -> list[tuple[tuple[int, ...], PlantGroup]]:
    """Return the plants on each shared supply, with the numbers of their axes."""
    numbers = {axis.name: number for number, axis in enumerate(config.axes)}
    return [(tuple(numbers[axis] for axis in each.axes), each) for each in supplies]


def build_supplies(config: BenchConfig) -> list[SupplyGroup]:
    """Return the supplies that axes share, with the plants of these axes."""
    by_name = {axis.name: axis for axis in config.axes}
    return [
        SupplyGroup(supply, [cast("Fed", by_name[axis]) for axis in supply.axes], config.dt)
        for supply in config.supplies
    ]


def build_plants(config: BenchConfig, supplies: Sequence[SupplyGroup]) -> dict[str, Plant]:
    """Return the plant of each axis by its name, those with their own supply and the others."""
    fed: dict[str, Plant] = {}
    for supply in supplies:
        fed |= dict(zip(supply.axes, supply.plants, strict=True))
    return {
        axis.name: fed.get(axis.name) or axis.kind.build(axis, config.dt) for axis in config.axes
    }


def number_buses(config: BenchConfig) -> dict[str, int]:
    """Return the number of the bus of each device, by the device's name."""
    numbers = {name: number for number, name in enumerate(config.buses)}
    of_ecus = {ecu.name: numbers[ecu.bus] for ecu in config.ecus}
    return {node.name: numbers[node.bus] for node in config.nodes} | of_ecus


def build_node(config: NodeConfig, agenda: Agenda | None = None) -> Node:
    """Return the CANopen node of one device, made from its EDS and what it has stored.

    Args:
        config: of the device.
        agenda: that of all nodes of the bench; see `Switchboard`.
    """
    object_dictionary = load_objects(config)
    storage = FileStorage(config.storage / f"{config.name}.parameters") if config.storage else None
    added = [make for each in given_to("services") for make in each.services(object_dictionary)]
    return Node(object_dictionary, config.node_id, storage, agenda, added)


def limit_node_periods(od: ObjectDictionary, config: NodeConfig, tick_ns: int) -> None:
    """Let a device refuse periods shorter than a tick, and say which it has already.

    Raises:
        ConfigError: the configuration gives one.
    """
    limit_periods(od, tick_ns)
    for variable in find_short_periods(od, tick_ns):
        key = variable.index, variable.subindex
        what = f"{name_object(*key)} {quote(variable.name)} is {variable.value}"
        tick = f"a tick of {tick_ns // 1000} us"
        if key in config.objects:
            right = "give a longer one, 0 for none, or a shorter tick_us"
            raise ConfigError(f"{config.place}.objects: {what}, shorter than {tick}; {right}")
        logger.warning("%s: %s, shorter than %s: it will be each tick", config.place, what, tick)


def protect_tpdos(node: Node, config: NodeConfig) -> None:
    """Give TPDOs of a node a counter and a checksum.

    Raises:
        ConfigError: one is not there, or too long.
    """
    for number in config.protected_tpdos:
        try:
            node.protect_tpdo(number)
        except ValueError as error:
            raise ConfigError(f"{config.place}.protected_tpdos: {error}") from None


def fit_node(config: NodeConfig, node: Node, surroundings: Surroundings) -> Fitting:
    """Fit the device of a node, with its objects that show quantities after the rest."""
    fitting = config.kind.fit(config, node, surroundings)
    sources = tuple(
        (source.axis, build_source(source, f"{config.name}.{source.name}", node, surroundings))
        for source in config.sources
    )
    own = [] if fitting.advance is None else [fitting.advance]
    scripts = [build_script(script, node) for script in config.scripts]
    others = [act for each in given_to("nodes") for act in each.build_acts(node, config.added)]
    added = [*scripts, *others]
    acts = [*own, *added]

    def advance(now: int) -> None:
        for act in acts:
            act(now)

    return replace(fitting, sources=sources, advance=advance if added else fitting.advance)


def build_axis(axis: AxisConfig, plant: Plant, fittings: Sequence[Fitting]) -> Axis:
    """Return a plant with its drive, its sensors and the objects bound to it."""
    drives = [drive for fitting in fittings for drive in fitting.drives]
    sensors = [sensor for fitting in fittings for sensor in fitting.sensors]
    sources = [source for fitting in fittings for source in fitting.sources]
    return Axis(
        name=axis.name,
        plant=plant,
        valve=next(drive.device for drive in drives if drive.axis == axis.name),
        sensors=tuple(sensor for name, sensor in (*sensors, *sources) if name == axis.name),
        quantities=axis.kind.quantities,
        influences=axis.influences,
        defects=axis.defects,
        follower=axis.kind.follower.output or 0,
    )


def group_plants(
    axes: Sequence[Axis], config: BenchConfig
) -> list[tuple[tuple[int, ...], PlantGroup]]:
    """Return the plants that are moved at once, with the numbers of their axes.

    Plants of one kind are, where the kind has a way to.
    """
    of_kind: dict[int, list[int]] = {}
    for number, axis in enumerate(config.axes):
        of_kind.setdefault(id(axis.kind), []).append(number)
    groups = []
    for numbers in of_kind.values():
        plants = [axes[number].plant for number in numbers]
        group = config.axes[numbers[0]].kind.group(plants) if len(plants) > 1 else None
        if group is not None:
            groups.append((tuple(numbers), group))
    return groups


def order_sensors(
    axes: Sequence[Axis], fittings: Mapping[str, Fitting], config: BenchConfig
) -> list[Measurement]:
    """Return all sensors as a recording has them: kind by kind, each axis by axis."""
    kinds = list(KINDS.built_in.values())
    ranks = {
        sensor.name: kinds.index(node.kind) if node.kind in kinds else len(kinds)
        for node in config.nodes
        for _, sensor in fittings[node.name].sensors
    }
    own = (sensor for each in fittings.values() for axis, sensor in each.sensors if axis is None)
    found = [*(sensor for axis in axes for sensor in axis.sensors), *own]
    return sorted(found, key=lambda sensor: ranks.get(sensor.name, len(kinds)))
