"""The resolved configuration: frozen records, SI inside, checked while they were loaded."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from hil_bench.config.choices import (
    FIRST_BUS,
    OverrunPolicy,
    PressureSource,
    Profile,
    Quantity,
    RealtimePolicy,
)
from hil_bench.errors import ConfigError
from hil_bench.faults.kinds import FaultKind
from hil_bench.measurement.parameters import ChainParameters
from hil_bench.modbus.data_types import WordOrder
from hil_bench.modbus.register_map import Holes, RegisterMap
from hil_bench.modbus.server_config import ServerConfig
from hil_bench.plant.models import Model
from hil_bench.plant.options import PlantOptions
from hil_bench.plant.parameters import PlantParameters
from hil_bench.plant.stepping import Solver
from hil_bench.tables.objects import ObjectValue, name_object
from hil_bench.tables.settings import Setting


@dataclass(frozen=True, slots=True)
class RealtimeConfig:
    """How a paced loop runs.

    Attributes:
        policy: with which real-time policy.
        priority: of SCHED_FIFO, 1 to 98.
        cpu: the only processor on which it runs, None for any.
        overrun: what it does after a tick that took too long.
    """

    policy: RealtimePolicy = RealtimePolicy.OFF
    priority: int = 80
    cpu: int | None = None
    overrun: OverrunPolicy = OverrunPolicy.COUNT


@dataclass(frozen=True, slots=True)
class BusConfig:
    """A CAN bus as python-can opens it; what is None is left to python-can's own configuration.

    Attributes:
        interface: python-can's name of the interface, as in ``socketcan``.
        channel: the channel of that interface, as in ``vcan0``.
        bitrate: bit rate [bit/s].
        options: further keyword arguments of that interface's bus class.
    """

    interface: str | None = None
    channel: str | int | None = None
    bitrate: int | None = None
    options: Mapping[str, str | int | float | bool] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class AxisConfig:
    """One axis: a cylinder and the hydraulic side of its valve.

    Attributes:
        name: the axis, as in ``[plant.NAME]``.
        model: which of the paper's.
        parameters: the model's parameters.
        options: what the paper leaves open.
        solver: the integration method.
        position: piston position at the start, from mid-stroke, positive when extending [m].
        spool_delay: what stands for the spool's lag in the reduced model [s].
    """

    name: str
    model: Model
    parameters: PlantParameters
    options: PlantOptions
    solver: Solver
    position: float
    spool_delay: float


@dataclass(frozen=True, slots=True)
class BindingConfig:
    """An object that is bound to a quantity of the plant.

    Attributes:
        index: of the object.
        subindex: of the object.
        axis: the axis whose quantity it is.
        quantity: what it shows or commands.
        scale: increments of the object for one SI unit; the spool counts in full openings.
        offset: value of the object at a quantity of 0.
        place: how messages name it.
    """

    index: int
    subindex: int
    axis: str
    quantity: Quantity
    scale: float
    offset: float
    place: str = field(compare=False)

    @property
    def name(self) -> str:
        """The object, as in ``0x6401.01``."""
        return name_object(self.index, self.subindex)


@dataclass(frozen=True, slots=True)
class SourceConfig(BindingConfig):
    """An object that shows a quantity.

    Attributes:
        delta: change that is an event for its TPDOs [increments]; None where none is.
        chain: what lies between the quantity and the object.
    """

    delta: float | None
    chain: ChainParameters


@dataclass(frozen=True, slots=True)
class SinkConfig(BindingConfig):
    """An object that commands the spool of an axis.

    Attributes:
        safe: set-point while nobody commands it [full openings].
        full_opening: spool position at 100 % [m].
    """

    safe: float
    full_opening: float


@dataclass(frozen=True, slots=True)
class NodeConfig:
    """What every CANopen node has.

    Attributes:
        name: the node, as in ``[nodes.NAME]``.
        profile: its device profile.
        axis: the name of the axis that it belongs to; None where it belongs to none.
        node_id: CANopen node-ID, 1 to 127; 255 for a node that waits for LSS to give it one.
        bus: the name of the bus that it is on.
        eds: its EDS file.
        storage: folder of the file that it stores its parameters in; None for memory.
        serial_number: 0x1018.04; None for that of the EDS file, or where that has none for one that
            is made of the node's name.
        objects: other power-on values than those of the EDS file, by index and sub-index.
        sources: the objects that show quantities of the plant.
        place: how messages name its table.
    """

    name: str
    profile: Profile
    axis: str | None
    node_id: int
    bus: str
    eds: Path
    storage: Path | None
    serial_number: int | None
    objects: Mapping[tuple[int, int], ObjectValue]
    sources: tuple[SourceConfig, ...]
    place: str = field(compare=False)

    @property
    def bindings(self) -> tuple[SourceConfig | SinkConfig, ...]:
        """All objects that are bound to the plant."""
        return self.sources


@dataclass(frozen=True, slots=True)
class ValveConfig(NodeConfig):
    """A proportional valve (CiA 408).

    Attributes:
        full_opening: spool position at a set-point of 100 % [m].
    """

    full_opening: float


@dataclass(frozen=True, slots=True)
class PressureConfig(NodeConfig):
    """A pressure transducer (CiA 404).

    Attributes:
        source: the pressure that it measures.
        span: measuring range, start and end [Pa].
        chain: what lies between the pressure and the transducer's objects.
    """

    source: PressureSource
    span: tuple[float, float]
    chain: ChainParameters


@dataclass(frozen=True, slots=True)
class EncoderConfig(NodeConfig):
    """A linear position sensor (CiA 406).

    Attributes:
        chain: what lies between the position and the sensor's objects.
    """

    chain: ChainParameters


@dataclass(frozen=True, slots=True)
class GenericConfig(NodeConfig):
    """A device made from its EDS file alone.

    Attributes:
        sinks: the objects that command the plant.
    """

    sinks: tuple[SinkConfig, ...]

    @property
    def bindings(self) -> tuple[SourceConfig | SinkConfig, ...]:
        """All objects that are bound to the plant."""
        return (*self.sources, *self.sinks)


@dataclass(frozen=True, slots=True)
class ModbusUnitConfig:
    """One device as Modbus clients see it.

    Attributes:
        name: the unit, as in ``[modbus.units.NAME]``.
        node: the name of the node that it shows.
        unit_id: its address, 1 to 247.
        register_map: what stands where.
        commands: whether clients may command the device.
        word_order: takes the place of the map's own, None where it does not.
        watchdog: of a valve, longest time between two commands at power-on [s]; 0 for any.
        holes: what an address is where the map has nothing.
    """

    name: str
    node: str
    unit_id: int
    register_map: RegisterMap
    commands: bool
    word_order: WordOrder | None
    watchdog: float
    holes: Holes


@dataclass(frozen=True, slots=True)
class ModbusConfig:
    """The Modbus server.

    Attributes:
        server: where it is found.
        units: the devices, each with its unit-ID.
    """

    server: ServerConfig
    units: tuple[ModbusUnitConfig, ...]


@dataclass(frozen=True, slots=True)
class FaultConfig:
    """A fault that happens by itself.

    Attributes:
        kind: what goes wrong.
        target: with what.
        at: when, in bench time [s].
        duration: for how long [s]; None for ever.
        values: what the kind needs to know, by parameter of its verb, in SI.
    """

    kind: FaultKind
    target: str
    at: float
    duration: float | None
    values: Mapping[str, float | int | str]


@dataclass(frozen=True, slots=True)
class BenchConfig:
    """A whole bench.

    Attributes:
        path: the file that it came from; None for the built-in bench.
        tick_ns: period of the loop [ns], an integer multiple of `step_ns`.
        step_ns: step of the plant's solver [ns].
        sync_period_ns: how far each SYNC moves a bench in lock-step [ns], an integer multiple of
            `tick_ns`.
        seed: seed of every random generator of the bench.
        bus: the first CAN bus, and mostly the only one.
        axes: the axes, in the order of the file.
        nodes: the nodes, in the order of the file.
        modbus: the Modbus server, None for none.
        faults: the faults, in the order of the file, those of the command line last.
        further_buses: the other buses by their names, in the order of the file.
        settings: every value as a person writes it, with its origin.
        realtime: how the loop runs where it is paced.
    """

    path: Path | None
    tick_ns: int
    step_ns: int
    sync_period_ns: int
    seed: int
    bus: BusConfig
    axes: tuple[AxisConfig, ...]
    nodes: tuple[NodeConfig, ...]
    modbus: ModbusConfig | None
    settings: tuple[Setting, ...]
    realtime: RealtimeConfig = field(default_factory=RealtimeConfig)
    faults: tuple[FaultConfig, ...] = ()
    further_buses: Mapping[str, BusConfig] = field(default_factory=dict)

    @property
    def buses(self) -> dict[str, BusConfig]:
        """All buses by their names; a frame has the number of its bus in this order."""
        return {FIRST_BUS: self.bus, **self.further_buses}

    @property
    def first_axis(self) -> AxisConfig:
        """The first axis.

        Raises:
            ConfigError: the bench has none.
        """
        if not self.axes:
            place = f"{self.path}:plant" if self.path else "plant"
            raise ConfigError(f"{place}: the bench has no axis; give it one, as [plant.axis1]")
        return self.axes[0]

    def seen_from(self, bus: str) -> "BenchConfig":
        """Return what is to be found on one of the buses: that bus alone, with its nodes."""
        nodes = tuple(node for node in self.nodes if node.bus == bus)
        return replace(self, bus=self.buses[bus], nodes=nodes, further_buses={})

    @property
    def steps_per_tick(self) -> int:
        """Plant steps in one tick."""
        return self.tick_ns // self.step_ns

    @property
    def ticks_per_sync(self) -> int:
        """Ticks from SYNC to SYNC in lock-step."""
        return self.sync_period_ns // self.tick_ns

    @property
    def dt(self) -> float:
        """Step of the plant's solver [s]."""
        return self.step_ns * 1e-9
