"""Finds what of a bench may have faults, and under which names."""

from collections.abc import Mapping, Sequence

from hil_bench.axis import Axis, Measurement, PositionMeasurement
from hil_bench.canopen_device.node import Node
from hil_bench.config import FaultConfig, GenericConfig, NodeConfig, ValveConfig
from hil_bench.devices.valve_408 import ValveDevice
from hil_bench.faults.effects import SensorPoint, SpoolPoint
from hil_bench.faults.faults import FaultPoints, Faults


def find_fault_points(
    axes: Sequence[Axis],
    nodes: Mapping[str, Node],
    configs: Sequence[NodeConfig],
    buses: Mapping[str, int],
) -> FaultPoints:
    """Return the points by the names of nodes and axes.

    An object that is bound to the plant is NODE.0x6401.01, or NODE where that has no other. The
    number of each node's bus stands in `buses`.
    """
    sensors: dict[str, SensorPoint] = {}
    for axis in axes:
        sensors |= {sensor.name: sensor_point(sensor) for sensor in axis.sensors}
    for config in configs:
        if len(config.sources) == 1 and config.name not in sensors:
            sensors[config.name] = sensors[f"{config.name}.{config.sources[0].name}"]
    return FaultPoints(
        sensors=sensors,
        valves=find_valves({axis.name: axis for axis in axes}, configs),
        supplies={axis.name: axis.plant for axis in axes},
        nodes=nodes,
        buses=buses,
    )


def sensor_point(sensor: Measurement) -> SensorPoint:
    """Return where a fault gets at a sensor."""
    speed_path = sensor.speed_path if isinstance(sensor, PositionMeasurement) else None
    return SensorPoint(sensor.path, speed_path)


def find_valves(axes: Mapping[str, Axis], configs: Sequence[NodeConfig]) -> dict[str, SpoolPoint]:
    """Return what commands a spool, by name."""
    valves: dict[str, SpoolPoint] = {}
    for config in configs:
        match config:
            case ValveConfig(axis=str(axis)):
                valves[config.name] = spool_point(axes[axis])
            case GenericConfig():
                points = {
                    f"{config.name}.{sink.name}": spool_point(axes[sink.axis])
                    for sink in config.sinks
                }
                if len(points) == 1:
                    points[config.name] = next(iter(points.values()))
                valves |= points
    return valves


def spool_point(axis: Axis) -> SpoolPoint:
    """Return where a fault gets at the valve of an axis."""
    device = axis.valve if isinstance(axis.valve, ValveDevice) else None
    return SpoolPoint(axis.command_path, axis.plant, device)


def schedule_faults(faults: Faults, configs: Sequence[FaultConfig]) -> None:
    """Make the faults of a configuration."""
    for config in configs:
        when = {"at": config.at}
        if config.duration is not None:
            when["duration"] = config.duration
        make = getattr(faults, config.kind.value)
        make(config.target, **config.values, **when)
