"""Finds what of a bench may have faults, and under which names."""

from collections.abc import Mapping, Sequence

from hil_bench.bench.configuration import FaultConfig
from hil_bench.bench.segment import Segment
from hil_bench.canopen_device.node import Node
from hil_bench.devices.axis import Axis, Fitting, Measurement
from hil_bench.devices.faults.ecu_point import EcuPoint
from hil_bench.devices.faults.effects import (
    DefectPoint,
    Enabled,
    SensorPoint,
    SpoolPoint,
    SupplyPoint,
)
from hil_bench.devices.faults.faults import Faults
from hil_bench.devices.faults.points import FaultPoints
from hil_bench.devices.faults.wire_point import WirePoint
from hil_bench.plants.hydraulic_cylinder.supply_group import SupplyGroup
from hil_bench.plants.quantity import SUPPLY


def find_fault_points(
    axes: Sequence[Axis],
    nodes: Mapping[str, Node],
    fittings: Mapping[str, Fitting],
    buses: Mapping[str, int],
    wires: Mapping[str, WirePoint],
    segments: Sequence[Segment] = (),
    supplies: Sequence[SupplyGroup] = (),
) -> FaultPoints:
    """Return the points by the names of nodes and axes.

    An object that is bound to the plant is NODE.0x6401.01, or NODE where that has no other. The
    number of each node's bus stands in `buses`, and those on a bus of copper in `wires`. The
    devices of `segments` have lines of their own.
    `supplies` are those that axes share.
    """
    by_name = {axis.name: axis for axis in axes}
    sensors: dict[str, SensorPoint] = {}
    valves: dict[str, SpoolPoint] = {}
    for fitting in fittings.values():
        sensors |= {sensor.name: sensor_point(sensor) for _, sensor in fitting.sensors}
    for name, fitting in fittings.items():
        points = {sensor.name: sensor_point(sensor) for _, sensor in fitting.sources}
        sensors |= points
        if len(points) == 1:
            sensors.setdefault(name, next(iter(points.values())))
        drives = {
            drive.name: spool_point(by_name[drive.axis], drive.enable) for drive in fitting.drives
        }
        if len(drives) == 1:
            drives.setdefault(name, next(iter(drives.values())))
        valves |= drives
    return FaultPoints(
        sensors=sensors,
        valves=valves,
        supplies={
            axis.name: SupplyPoint(axis.plant, influence.low)
            for axis in axes
            for influence in axis.influences
            if influence.name == SUPPLY
        }
        | {supply.name: SupplyPoint(supply, supply.lowest) for supply in supplies},
        plants={
            axis.name: DefectPoint(axis.plant, {each.name: each for each in axis.defects}, {})
            for axis in axes
        }
        | {
            supply.name: DefectPoint(supply, {each.name: each for each in supply.defects}, {})
            for supply in supplies
        },
        nodes=nodes,
        buses=buses,
        wires=wires,
        ecus={
            station.name: EcuPoint(station.ecu, station.line, station.signals)
            for segment in segments
            for station in segment.stations
        },
    )


def sensor_point(sensor: Measurement) -> SensorPoint:
    """Return the point at which faults act on a sensor."""
    return SensorPoint(sensor.path, sensor.rate_path)


def spool_point(axis: Axis, enable: Enabled | None) -> SpoolPoint:
    """Return the point at which faults act on the valve of an axis."""
    return SpoolPoint(
        axis.command_path,
        lambda: axis.plant.output[axis.follower],
        enable,
        axis.valve.full_opening,
    )


def schedule_faults(faults: Faults, configs: Sequence[FaultConfig]) -> None:
    """Make the faults of a configuration."""
    for config in configs:
        when = {"at": config.at}
        if config.duration is not None:
            when["duration"] = config.duration
        make = getattr(faults, config.kind.value)
        make(config.target, **config.values, **when)
