"""Builds a bench from its configuration: plants, nodes and the devices that join them.

>>> bus = embedded_bus()                         # the built-in bench, virtual time
>>> bus = embedded_bus(load_config("bench.toml"))
"""

from hil_bench.bench import (
    Axis,
    Bench,
    Measurement,
    PositionMeasurement,
    PressureMeasurement,
    QuantityMeasurement,
    SpoolCommand,
)
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.file_storage import FileStorage
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
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
from hil_bench.config.objects import override_defaults
from hil_bench.devices.bound_objects import CommandWatch, QuantitySource, SpoolSink
from hil_bench.devices.encoder_406 import EncoderDevice
from hil_bench.devices.pressure_404 import PressureDevice
from hil_bench.devices.valve_408 import ValveDevice
from hil_bench.errors import ConfigError, EdsError
from hil_bench.fault_points import find_fault_points, schedule_faults
from hil_bench.faults.faults import Faults
from hil_bench.measurement.chain import MeasuringChain
from hil_bench.measurement.noise import random_stream
from hil_bench.plant.models import plant_at_rest
from hil_bench.transports.embedded import EmbeddedBus

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
    """Return a bus with a powered-on bench at its other end, in the caller's thread.

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
    nodes = {node.name: build_node(node) for node in config.nodes}
    commands = build_commands(config, nodes)
    axes = [build_axis(axis, config, nodes, commands[axis.name]) for axis in config.axes]
    points = find_fault_points(axes, nodes, config.nodes)
    faults = Faults(points, tick_ns=config.tick_ns, seed=config.seed)
    schedule_faults(faults, config.faults)
    return Bench(axes, list(nodes.values()), steps=config.steps_per_tick, faults=faults)


def build_node(config: NodeConfig) -> Node:
    """Return the CANopen node of one device, made from its EDS and what it has stored."""
    object_dictionary = load_objects(config)
    storage = FileStorage(config.storage / f"{config.name}.parameters") if config.storage else None
    return Node(object_dictionary, config.node_id, storage)


def load_objects(config: NodeConfig) -> ObjectDictionary:
    """Return the objects of one device with what they hold at power-on."""
    object_dictionary = load_eds(config.eds, config.node_id)
    if config.serial_number is not None:
        set_serial_number(object_dictionary, config.serial_number)
    override_defaults(
        object_dictionary, config.objects, place=f"{config.place}.objects", node_id=config.node_id
    )
    for binding in config.bindings:
        find_bound(object_dictionary, binding)
    return object_dictionary


def set_serial_number(object_dictionary: ObjectDictionary, serial_number: int) -> None:
    """Give a device a serial number of its own.

    Raises:
        EdsError: the device has no object for it.
    """
    variable = object_dictionary.find(0x1018, 4)
    if variable is None:
        raise EdsError(
            f"{object_dictionary.source}: object 0x1018.04, the serial number, is missing"
        )
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
        build_sensor(node, nodes[node.name], build_chain(node, config))
        for node in config.nodes
        if node.axis == axis.name and not isinstance(node, ValveConfig)
    ]
    sources = [
        build_source(source, node.name, nodes[node.name], valve.full_opening)
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


def build_source(config: SourceConfig, owner: str, node: Node, full_opening: float) -> Measurement:
    """Return what hands a quantity of the plant to an object of a node."""
    is_spool = config.quantity is Quantity.SPOOL_POSITION
    source = QuantitySource(
        node,
        find_bound(node.object_dictionary, config),
        scale=config.scale / full_opening if is_spool else config.scale,
        offset=config.offset,
        delta=config.delta,
    )
    name = f"{owner}.{config.name}"
    return QuantityMeasurement(source, _OUTPUTS[config.quantity], name=name)


def build_chain(node: NodeConfig, config: BenchConfig) -> MeasuringChain | None:
    """Return the measuring chain of a node, None where it has none or an ideal one."""
    if not isinstance(node, PressureConfig | EncoderConfig) or node.chain.is_ideal:
        return None
    return MeasuringChain(node.chain, config.tick_ns, random_stream(config.seed, node.name))


def build_sensor(config: NodeConfig, node: Node, chain: MeasuringChain | None) -> Measurement:
    """Return what hands the plant's quantities to one sensor, by its chain if it has one.

    Raises:
        ConfigError: the node is no sensor.
    """
    stages = () if chain is None else (chain.measure,)
    match config:
        case PressureConfig():
            device = PressureDevice(node, config.span)
            return PressureMeasurement(device, config.source, stages, name=config.name)
        case EncoderConfig():
            speed_stages = () if chain is None else (chain.speed,)
            encoder = EncoderDevice(node)
            return PositionMeasurement(encoder, stages, speed_stages, name=config.name)
        case _:
            raise ConfigError(f"nodes.{config.name}: profile {config.profile} is not a sensor")
