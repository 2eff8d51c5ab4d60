"""Finds what of a bench may have faults, and under which names."""

from collections.abc import Mapping, Sequence
from functools import partial

from hil_bench.bench.configuration import FaultConfig
from hil_bench.bench.peers import Peers
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.nmt import NMT_COB_ID, NmtCommand
from hil_bench.canopen_device.node import Node
from hil_bench.devices.axis import Axis, Fitting, Measurement
from hil_bench.devices.faults.effects import DefectPoint, SensorPoint, SpoolPoint, SupplyPoint
from hil_bench.devices.faults.faults import Faults
from hil_bench.devices.faults.points import (
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
from hil_bench.devices.faults.wire_point import WirePoint
from hil_bench.plants.hydraulic_cylinder.supply_group import SupplyGroup
from hil_bench.plants.quantity import SUPPLY

_RESET = Frame(NMT_COB_ID, bytes((NmtCommand.RESET_NODE, 0)))


def find_fault_points(
    axes: Sequence[Axis],
    nodes: Mapping[str, Node],
    fittings: Mapping[str, Fitting],
    buses: Mapping[str, int],
    wires: Mapping[str, WirePoint],
    peers: Peers,
    supplies: Sequence[SupplyGroup] = (),
) -> FaultPoints:
    """Return the points by the names of nodes and axes.

    An object that is bound to the plant is NODE.0x6401.01, or NODE where that has no other. The
    number of each node's bus stands in `buses`, and those on a bus of copper in `wires`. `peers`
    are the devices beside the nodes, `supplies` those that axes share.
    """
    points = FaultPoints()
    _add_signals(points, {axis.name: axis for axis in axes}, fittings)
    held, worn = points.of(SUPPLIES), points.of(PLANTS)
    for axis in axes:
        for influence in axis.influences:
            if influence.name == SUPPLY:
                held[axis.name] = SupplyPoint(axis.plant, influence.low)
        worn[axis.name] = DefectPoint(axis.plant, {each.name: each for each in axis.defects}, {})
    for supply in supplies:
        held[supply.name] = SupplyPoint(supply, supply.lowest)
        worn[supply.name] = DefectPoint(supply, {each.name: each for each in supply.defects}, {})
    for name, node in nodes.items():
        reset = partial(node.receive, _RESET)
        points.of(NODES)[name] = NodePoint(node, reset, reset, buses[name])
    points.of(WIRED).update(wires)
    peers.add_points(points, buses)
    return points


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


def schedule_faults(faults: Faults, configs: Sequence[FaultConfig]) -> None:
    """Make the faults of a configuration."""
    for each in configs:
        faults.begin(each.kind, each.target, at=each.at, duration=each.duration, **each.values)
