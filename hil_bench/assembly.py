"""Builds a bench from its configuration: plants, nodes and the devices that join them.

>>> bus = embedded_bus()                         # the built-in bench, virtual time
>>> bus = embedded_bus(load_config("bench.toml"))
"""

import logging

from hil_bench.axis import (
    Axis,
    Measurement,
    PositionMeasurement,
    PressureMeasurement,
    QuantityMeasurement,
    SpoolCommand,
)
from hil_bench.bench import Bench
from hil_bench.canopen_device.agenda import Agenda
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.file_storage import FileStorage
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.periods import find_short_periods, limit_periods
from hil_bench.config import (
    AxisConfig,
    BenchConfig,
    EncoderConfig,
    GenericConfig,
    NodeConfig,
    PressureConfig,
    Quantity,
    SinkConfig,
    SourceConfig,
    ValveConfig,
    load_config,
)
from hil_bench.config.bindings import find_bound
from hil_bench.devices.bound_objects import CommandWatch, QuantitySource, SpoolSink
from hil_bench.devices.encoder_406 import EncoderDevice
from hil_bench.devices.pressure_404 import PressureDevice
from hil_bench.devices.valve_408 import ValveDevice
from hil_bench.errors import ConfigError, EdsError
from hil_bench.fault_points import find_fault_points, schedule_faults
from hil_bench.faults.faults import Faults
from hil_bench.measurement.chain import MeasuringChain
from hil_bench.measurement.noise import random_stream
from hil_bench.measurement.parameters import ChainParameters
from hil_bench.plant.models import plant_at_rest
from hil_bench.switchboard import Switchboard
from hil_bench.tables.objects import name_object, named_serial_number, override_defaults
from hil_bench.tables.values import quote
from hil_bench.transports.embedded import EmbeddedBus

logger = logging.getLogger(__name__)

_OUTPUTS = {
    Quantity.POSITION: "x",
    Quantity.SPEED: "v",
    Quantity.P_A: "P_A",
    Quantity.P_B: "P_B",
    Quantity.Q_A: "Q_A",
    Quantity.Q_B: "Q_B",
    Quantity.SPOOL_POSITION: "nu",
}
"""What each quantity is among the plant's outputs."""


def embedded_bus(config: BenchConfig | None = None) -> EmbeddedBus:
    """Return a bus, the first, with a powered-on bench at its other end, in the caller's thread.

    Bench time advances only while the caller waits in `recv`.

    Args:
        config: the bench; without it the built-in one of one axis.
    """
    config = config or load_config()
    bench = build_bench(config)
    bench.start(0)
    return EmbeddedBus(bench.tick, config.tick_ns)


def build_bench(config: BenchConfig) -> Bench:
    """Return the bench that `config` describes, not yet powered on."""
    agenda = Agenda()
    nodes = {node.name: build_node(node, agenda) for node in config.nodes}
    for member in config.nodes:
        limit_node_periods(nodes[member.name].object_dictionary, member, config.tick_ns)
    commands = build_commands(config, nodes)
    axes = [build_axis(axis, config, nodes, commands[axis.name]) for axis in config.axes]
    buses = number_buses(config)
    points = find_fault_points(axes, nodes, config.nodes, buses)
    faults = Faults(points, tick_ns=config.tick_ns, seed=config.seed)
    schedule_faults(faults, config.faults)
    switchboard = Switchboard({nodes[name]: number for name, number in buses.items()}, agenda)
    return Bench(axes, switchboard, steps=config.steps_per_tick, faults=faults)


def number_buses(config: BenchConfig) -> dict[str, int]:
    """Return the number of the bus of each node, by the node's name."""
    numbers = {name: number for number, name in enumerate(config.buses)}
    return {node.name: numbers[node.bus] for node in config.nodes}


def build_node(config: NodeConfig, agenda: Agenda | None = None) -> Node:
    """Return the CANopen node of one device, made from its EDS and what it has stored.

    Args:
        config: of the device.
        agenda: that of all nodes of the bench; see `Switchboard`.
    """
    object_dictionary = load_objects(config)
    storage = FileStorage(config.storage / f"{config.name}.parameters") if config.storage else None
    return Node(object_dictionary, config.node_id, storage, agenda)


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


def load_objects(config: NodeConfig) -> ObjectDictionary:
    """Return the objects of one device with what they hold at power-on."""
    object_dictionary = load_eds(config.eds, config.node_id)
    set_serial_number(object_dictionary, config)
    override_defaults(
        object_dictionary, config.objects, place=f"{config.place}.objects", node_id=config.node_id
    )
    for binding in config.bindings:
        find_bound(object_dictionary, binding)
    return object_dictionary


def set_serial_number(object_dictionary: ObjectDictionary, config: NodeConfig) -> None:
    """Give a device a serial number of its own, which no change of its node-ID changes.

    Raises:
        EdsError: the configuration gives one, and the device has no object for it.
    """
    variable = object_dictionary.find(0x1018, 4)
    if variable is None and config.serial_number is not None:
        raise EdsError(
            f"{object_dictionary.source}: object 0x1018.04, the serial number, is missing"
        )
    if variable is None or not isinstance(variable.default, int):
        return
    serial_number = config.serial_number
    if serial_number is None:
        of_its_own = 0 if variable.base is not None else variable.default
        serial_number = of_its_own or named_serial_number(config.name)
    variable.base = None
    variable.default = variable.value = serial_number


def build_axis(
    axis: AxisConfig, config: BenchConfig, nodes: dict[str, Node], valve: SpoolCommand
) -> Axis:
    """Return one cylinder with its valve, its sensors and the objects bound to it."""
    plant = plant_at_rest(
        axis.model,
        axis.parameters,
        options=axis.options,
        solver=axis.solver,
        dt=config.dt,
        x=axis.position,
        delay=axis.spool_delay,
    )
    sensors = [
        build_sensor(node, nodes[node.name], config)
        for node in config.nodes
        if node.axis == axis.name and not isinstance(node, ValveConfig)
    ]
    sources = [
        build_source(source, f"{node.name}.{source.name}", config, nodes[node.name], valve)
        for node in config.nodes
        for source in node.sources
        if source.axis == axis.name
    ]
    return Axis(name=axis.name, plant=plant, valve=valve, sensors=(*sensors, *sources))


def build_commands(config: BenchConfig, nodes: dict[str, Node]) -> dict[str, SpoolCommand]:
    """Return what commands the spool of each axis: its valve, or the sink in its place."""
    commands: dict[str, SpoolCommand] = {}
    for member in config.nodes:
        node = nodes[member.name]
        match member:
            case ValveConfig(axis=str(axis)):
                commands[axis] = ValveDevice(node, member.full_opening)
            case GenericConfig():
                watch = CommandWatch(node)
                commands |= {sink.axis: build_sink(sink, node, watch) for sink in member.sinks}
    return commands


def build_sink(config: SinkConfig, node: Node, watch: CommandWatch) -> SpoolSink:
    """Return the object of a node that commands a spool."""
    return SpoolSink(
        watch,
        find_bound(node.object_dictionary, config),
        scale=config.scale,
        offset=config.offset,
        safe=config.safe,
        full_opening=config.full_opening,
    )


def build_source(
    source: SourceConfig, name: str, config: BenchConfig, node: Node, valve: SpoolCommand
) -> Measurement:
    """Return what hands a quantity of the plant to an object of a node, by its chain if any."""
    is_spool = source.quantity is Quantity.SPOOL_POSITION
    shown = QuantitySource(
        node,
        find_bound(node.object_dictionary, source),
        scale=source.scale / valve.full_opening if is_spool else source.scale,
        offset=source.offset,
        delta=source.delta,
    )
    chain = build_chain(source.chain, name, config)
    stages = () if chain is None else (chain.measure,)
    return QuantityMeasurement(shown, _OUTPUTS[source.quantity], stages, name=name)


def build_chain(
    parameters: ChainParameters, name: str, config: BenchConfig
) -> MeasuringChain | None:
    """Return the measuring chain of the sensor of a name, None where it is ideal."""
    if parameters.is_ideal:
        return None
    return MeasuringChain(parameters, config.tick_ns, random_stream(config.seed, name))


def stroke_of(sensor: EncoderConfig, config: BenchConfig) -> tuple[float, float]:
    """Return the ends of the stroke [m] that an encoder measures."""
    half = next(axis.parameters.h for axis in config.axes if axis.name == sensor.axis)
    return -half, half


def build_sensor(sensor: NodeConfig, node: Node, config: BenchConfig) -> Measurement:
    """Return what hands the plant's quantities to one sensor, by its chain if any.

    Raises:
        ConfigError: the node is no sensor.
    """
    match sensor:
        case PressureConfig():
            chain = build_chain(sensor.chain, sensor.name, config)
            stages = () if chain is None else (chain.measure,)
            device = PressureDevice(node, sensor.span)
            return PressureMeasurement(device, sensor.source, stages, name=sensor.name)
        case EncoderConfig():
            chain = build_chain(sensor.chain, sensor.name, config)
            stages = () if chain is None else (chain.measure,)
            speed_stages = () if chain is None else (chain.speed,)
            encoder = EncoderDevice(node, stroke_of(sensor, config))
            return PositionMeasurement(encoder, stages, speed_stages, name=sensor.name)
        case _:
            raise ConfigError(f"nodes.{sensor.name}: profile {sensor.profile} is not a sensor")
