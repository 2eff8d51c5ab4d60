"""The faults of a bench: what of it may have some, under which names, and those of its file."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Protocol, runtime_checkable

from hil_bench.abilities.faults.effects import (
    Act,
    DefectPoint,
    SensorPoint,
    SpoolPoint,
    SupplyPoint,
)
from hil_bench.abilities.faults.fault import FaultConfig
from hil_bench.abilities.faults.faults import Faults
from hil_bench.abilities.faults.points import (
    ENABLES,
    NODES,
    PLANTS,
    SENSORS,
    SUPPLIES,
    VALVES,
    WIRED,
    FaultPoints,
    NodePoint,
)
from hil_bench.bench.assembly import number_buses
from hil_bench.bench.bench import Bench
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.peers import peers_of
from hil_bench.canopen_device.node import Node
from hil_bench.devices.axis import Axis, Fitting, Measurement
from hil_bench.plants.hydraulic_cylinder.supply_group import SupplyGroup
from hil_bench.plants.plant import SUPPLY


def build_faults(config: BenchConfig, bench: Bench, planned: Sequence[FaultConfig]) -> Faults:
    """Return the faults of a bench, those of its file planned."""
    points = find_fault_points(config, bench)
    faults = Faults(points, bench, tick_ns=config.tick_ns, seed=config.seed)
    schedule_faults(faults, planned)
    faults.of_file = faults.pending
    return faults


def schedule_faults(faults: Faults, configs: Sequence[FaultConfig]) -> None:
    """Make the faults of a configuration."""
    for each in configs:
        faults.begin(each.kind, each.target, at=each.at, duration=each.duration, **each.values)


@runtime_checkable
class Fallible(Protocol):
    """An extension that has points of its own at which faults act."""

    def add_points(self, points: FaultPoints, buses: Mapping[str, int]) -> None:
        """Add them, given the number of the bus of each device."""


def find_fault_points(config: BenchConfig, bench: Bench) -> FaultPoints:
    """Return the points of a bench by the names of nodes and axes.

    An object that is bound to the plant is NODE.0x6401.01, or NODE where that has no other.
    """
    points, peers, buses = FaultPoints(), peers_of(bench), number_buses(config)
    nodes = dict(zip((node.name for node in config.nodes), bench.nodes, strict=True))
    fittings = {**dict(zip(nodes, bench.fittings, strict=True)), **peers.fittings}
    _add_signals(points, {axis.name: axis for axis in bench.axes}, fittings)
    held, worn = points.of(SUPPLIES), points.of(PLANTS)
    for axis in bench.axes:
        for influence in axis.influences:
            if influence.name == SUPPLY:
                held[axis.name] = SupplyPoint(axis.plant, influence)
        worn[axis.name] = DefectPoint(axis.plant, {each.name: each for each in axis.defects}, {})
    for _, supply in bench.groups:
        if isinstance(supply, SupplyGroup):
            held[supply.name] = SupplyPoint(supply, supply.held)
            defects = {each.name: each for each in supply.defects}
            worn[supply.name] = DefectPoint(supply, defects, {})
    for name, node in nodes.items():
        points.of(NODES)[name] = NodePoint(
            node, partial(_switch_off, node), partial(_switch_on, node), buses[name]
        )
    if bench.medium is not None:
        devices = {**nodes, **{name: peer.ecu for name, peer in peers.items()}}
        plugs = {name: bench.medium.point(device) for name, device in devices.items()}
        points.of(WIRED).update({name: plug for name, plug in plugs.items() if plug is not None})
    for extension in bench.extensions:
        if isinstance(extension, Fallible):
            extension.add_points(points, buses)
    _cut_sensors_off(points.of(NODES), fittings)
    return points


def _switch_off(node: Node, _now: int) -> None:
    node.switch_off()


def _switch_on(node: Node, now: int) -> None:
    node.switch_off()  # forgets what its device has done meanwhile
    node.start(now)


def _cut_sensors_off(nodes: dict[str, NodePoint], fittings: Mapping[str, Fitting]) -> None:
    """Let the sensors of each device lose their power with it."""

    def switch(act: Act, fitting: Fitting, now: int, *, has_power: bool) -> None:
        act(now)
        for _, sensor in (*fitting.sensors, *fitting.sources):
            sensor.has_power = has_power

    for name, fitting in fittings.items():
        if name in nodes:
            point = nodes[name]
            off = partial(switch, point.off, fitting, has_power=False)
            on = partial(switch, point.on, fitting, has_power=True)
            nodes[name] = point._replace(off=off, on=on)


def _add_signals(
    points: FaultPoints, axes: Mapping[str, Axis], fittings: Mapping[str, Fitting]
) -> None:
    """Add sensors and valves of devices."""
    sensors, valves, enables = points.of(SENSORS), points.of(VALVES), points.of(ENABLES)
    for fitting in fittings.values():
        sensors |= {sensor.name: sensor_point(sensor) for _, sensor in fitting.sensors}
    for name, fitting in fittings.items():
        sources = {sensor.name: sensor_point(sensor) for _, sensor in fitting.sources}
        sensors |= sources
        if len(sources) == 1:
            sensors.setdefault(name, next(iter(sources.values())))
        for drive in fitting.drives:
            names = [drive.name, name] if len(fitting.drives) == 1 else [drive.name]
            for each in names:
                valves.setdefault(each, spool_point(axes[drive.axis]))
                if drive.enable is not None:
                    enables.setdefault(each, drive.enable)


def sensor_point(sensor: Measurement) -> SensorPoint:
    """Return the point at which faults act on a sensor."""
    return SensorPoint(sensor.path, sensor.rate_path)


def spool_point(axis: Axis) -> SpoolPoint:
    """Return the point at which faults act on the valve of an axis."""
    return SpoolPoint(
        axis.command_path,
        lambda: axis.plant.output[axis.follower],
        axis.valve.full_opening,
    )
