"""The resolved configuration: frozen records, SI inside, checked while they were loaded."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Protocol, TypeVar

from hil_bench.config.settings import Setting
from hil_bench.devices.kinds.kind import NodeConfig
from hil_bench.errors import ConfigError
from hil_bench.outside.bits import USUAL_BITRATE
from hil_bench.outside.realtime.clock import RealtimeConfig
from hil_bench.plants.hydraulic_cylinder.supply_group import SupplyConfig
from hil_bench.plants.plant import AxisConfig

FIRST_BUS = "bus"
"""Name of the bus of the table ``[bus]``."""


class Carrier(Protocol):
    """A wire on which frames take time."""

    def medium(self, config: "BenchConfig", devices: Mapping[str, Any]) -> Any:  # noqa: ANN401 - of layers above
        """Return the extension for all such buses of a bench with these devices."""


@dataclass(frozen=True, slots=True)
class BusConfig:
    """A CAN bus as python-can opens it; what is None is left to python-can's own configuration.

    Attributes:
        interface: python-can's name of the interface, as in ``socketcan``.
        channel: the channel of that interface, as in ``vcan0``.
        bitrate: bit rate [bit/s].
        options: further keyword arguments of that interface's bus class.
        wire: of its table ``wire``; None for a bus that takes no time.
        fd: whether it carries frames of CAN FD, too.
        data_bitrate: bit rate of their data phase [bit/s]; None for that of the rest.
    """

    interface: str | None = None
    channel: str | int | None = None
    bitrate: int | None = None
    options: Mapping[str, str | int | float | bool] = field(default_factory=dict)
    wire: Carrier | None = None
    fd: bool = False
    data_bitrate: int | None = None

    @property
    def address(self) -> tuple[str | None, str | int | None, int | None, Mapping[str, object]]:
        """The address of the bus: interface, channel, bit rate and options."""
        options = dict(self.options)
        if self.fd:
            options["fd"] = True
        if self.data_bitrate is not None:
            options["data_bitrate"] = self.data_bitrate
        return self.interface, self.channel, self.bitrate, options

    @property
    def speedup(self) -> float:
        """The data bit rate of CAN FD over the bit rate; 1 where both are the same."""
        return (self.data_bitrate or 0) / (self.bitrate or USUAL_BITRATE) or 1.0


class Served(Protocol):
    """The open ends of a part that serves others in a run.

    Attributes:
        lines: on where it is found, at the start of the run.
        helpers: its processes, each a `hil_bench.cli.helpers.Helper`.
    """

    @property
    def lines(self) -> Sequence[str]: ...  # noqa: D102 - see above

    @property
    def helpers(self) -> Sequence[Any]: ...  # noqa: D102


class ShownDevice(NamedTuple):
    """A device beside the CANopen nodes, as `hil-bench devices` shows it.

    Attributes:
        title: what stands before its name, as in "J1939 19".
        content: for programs; name, kind, axis and bus are shown to people, too.
        lines: below these.
    """

    title: str
    content: Mapping[str, Any]
    lines: Sequence[str]


class Part:
    """A part of a bench that an ability's table describes; what it does not define, it does not do.

    Attributes:
        is_fitted: whether its extension is fitted to the devices, which may refuse it.
        real_time_only: of one that serves others: why it cannot but in real time, and what else to
            leave out.
        ecus: devices beside the CANopen nodes: their configurations, each with a name, a bus and a
            kind.
    """

    __slots__ = ()
    is_fitted: ClassVar[bool] = False
    real_time_only: ClassVar[str] = ""
    ecus: tuple[Any, ...] = ()

    @property
    def lines(self) -> tuple[str, ...]:
        """The lines on it at the start of a run."""
        return ()

    def attached(self, session: Any, config: "BenchConfig") -> AbstractContextManager[object]:  # noqa: ANN401 - of a layer above
        """Return the part at work on a session, from before its first tick to its end."""
        return nullcontext()

    def served(
        self,
        session: Any,  # noqa: ANN401 - of a layer above
        config: "BenchConfig",
    ) -> AbstractContextManager[Served] | None:
        """Return the part at work on a session that runs by the clock, in place of `attached`.

        It serves others by processes beside the loop; None for one that serves nobody.
        """
        return None

    def extension(self, config: "BenchConfig", bench: Any) -> Any:  # noqa: ANN401 - of layers above
        """Return the extension that joins the bench; `ConfigError` where it does not fit."""
        return None

    def peers(self, config: "BenchConfig", surroundings: Any) -> Any:  # noqa: ANN401 - of layers above
        """Return the devices of `ecus`, built, as `hil_bench.bench.peers.Peers`."""
        return None

    def shown_devices(self, config: "BenchConfig") -> Iterable[ShownDevice]:
        """Return the devices of `ecus`, bus by bus."""
        return ()

    def find_doubts(self, config: "BenchConfig") -> Iterable[str]:
        """Return doubts about it, without the name of the file, a line each."""
        return ()

    def sound(self) -> "Part":
        """Return the part by which nothing goes wrong on the bench."""
        return self

    def seen_from(self, bus: str) -> "Part":
        """Return the part reduced to the devices of one bus, which is then the first."""
        return self


PartT = TypeVar("PartT")


@dataclass(frozen=True, slots=True)
class BenchConfig:
    """A whole bench.

    Attributes:
        path: the file that it came from; None for the built-in bench.
        tick_ns: period of the loop [ns], an integer multiple of `step_ns`.
        step_ns: step of the plant's solver [ns].
        sync_period_ns: how far each SYNC moves a bench whose time is its count [ns], an integer
            multiple of `tick_ns`.
        seed: seed of every random generator of the bench.
        bus: the first CAN bus, and mostly the only one.
        axes: the axes, in the order of the file.
        nodes: the nodes, in the order of the file.
        further_buses: the other buses by their names, in the order of the file.
        settings: every value as a person writes it, with its origin.
        realtime: how the loop runs where it is paced.
        supplies: those that several axes share, in the order of the file.
        parts: what the tables of abilities say.
    """

    path: Path | None
    tick_ns: int
    step_ns: int
    sync_period_ns: int
    seed: int
    bus: BusConfig
    axes: tuple[AxisConfig, ...]
    nodes: tuple[NodeConfig, ...]
    settings: tuple[Setting, ...]
    realtime: RealtimeConfig = field(default_factory=RealtimeConfig)
    further_buses: Mapping[str, BusConfig] = field(default_factory=dict)
    supplies: tuple[SupplyConfig, ...] = ()
    parts: tuple[Part, ...] = ()

    def of(self, kind: type[PartT]) -> PartT | None:
        """Return the part of an ability's table; None where the file has no such table.

        Args:
            kind: its class.
        """
        return next((part for part in self.parts if isinstance(part, kind)), None)

    @property
    def ecus(self) -> tuple[Any, ...]:
        """The devices beside the nodes, those on J1939, in the order of the file."""
        return tuple(ecu for part in self.parts for ecu in part.ecus)

    @property
    def sound(self) -> "BenchConfig":
        """The same bench, on which nothing goes wrong by itself."""
        return replace(self, parts=tuple(part.sound() for part in self.parts))

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
        """Return the configuration reduced to one of the buses, as its first, and its nodes."""
        nodes = tuple(replace(node, bus=FIRST_BUS) for node in self.nodes if node.bus == bus)
        parts = tuple(part.seen_from(bus) for part in self.parts)
        return replace(self, bus=self.buses[bus], nodes=nodes, further_buses={}, parts=parts)

    def full_scale(self, axis: AxisConfig) -> float:
        """Return the command that stands for 1 in a recording, of a spool the position [m]."""
        scales: dict[str, float] = {}
        for ecu in self.ecus:
            scales |= ecu.kind.full_scales(ecu)
        for node in self.nodes:
            scales |= node.kind.full_scales(node)
        if axis.name in scales:
            return scales[axis.name]
        return axis.full_scale

    @property
    def steps_per_tick(self) -> int:
        """Plant steps in one tick."""
        return self.tick_ns // self.step_ns

    @property
    def ticks_per_sync(self) -> int:
        """Ticks from SYNC to SYNC, where each moves the bench."""
        return self.sync_period_ns // self.tick_ns

    @property
    def dt(self) -> float:
        """Step of the plant's solver [s]."""
        return self.step_ns * 1e-9
