"""The J1939 devices of a bench: built from their configuration, and set and read by tests."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from numbers import Real
from typing import Any, Protocol

from hil_bench.abilities.j1939.kinds.ecu import EcuConfig
from hil_bench.abilities.j1939.protocol.address_claim import ClaimState
from hil_bench.abilities.j1939.protocol.diagnostics import TroubleCode
from hil_bench.abilities.j1939.protocol.ecu import Ecu
from hil_bench.abilities.j1939.protocol.signal_table import SentSignal
from hil_bench.abilities.j1939.protocol.signals import COMPONENT, EcuValue
from hil_bench.bench.bench import Bench
from hil_bench.bench.peers import Peers
from hil_bench.canopen_device.frame import Emit, Frame, Handler
from hil_bench.devices.axis import Fitting
from hil_bench.devices.kinds.bindings import Surroundings
from hil_bench.errors import ConfigError
from hil_bench.units import ONE

# The J1939 devices of a bench on one bus, and what they hear of each other.


@dataclass(frozen=True, slots=True, eq=False)
class EcuStation:
    """A J1939 device at its bus.

    Attributes:
        name: as in the configuration.
        ecu: its ECU.
        advance: what the device does in each tick [ns]; None where it has nothing to do.
        signals: what it sends and a fault may indicate, by name.
        values: what it shows, by name.
    """

    name: str
    ecu: Ecu
    advance: Callable[[int], None] | None
    signals: dict[str, SentSignal]
    values: dict[str, EcuValue]


class Board(Protocol):
    """The board that a segment is plugged into."""

    @property
    def emit(self) -> Emit:
        """Takes a frame that is sent."""

    def connect(self, device: object, emit: Emit) -> tuple[Emit, Callable[[], None] | None]:
        """Put the ways of a device, as its CAN controller on copper, between it and `emit`."""

    def guard(self, device: object, handle: Handler) -> Handler:
        """Wrap a handler of a device so that frames from the bus pass its ways first."""

    def host(
        self, bus: int, take: Handler, begin: Callable[[int], None], plug: Callable[[], None]
    ) -> None:
        """Hand frames with a 29-bit identifier to `take`; call `begin` before each round."""


class Segment:
    """All J1939 devices of one bus.

    What one of them sends goes to the bus, and in the next round to the others; on a bus of copper
    once it has passed.

    Args:
        number: of the bus.
        stations: the devices.

    Attributes:
        number: as passed in.
        stations: as passed in.
    """

    def __init__(self, number: int, stations: Sequence[EcuStation]) -> None:
        self.number = number
        self.stations = tuple(stations)
        self._board: Board | None = None
        self._sent: list[tuple[EcuStation, Frame]] = []
        self._heard: list[tuple[EcuStation, Frame]] = []
        self._takers: list[tuple[EcuStation, Handler]] = []
        self._senders: list[tuple[EcuStation, Emit, Callable[[], None] | None]] = []

    def join(self, board: Board) -> None:
        """Plug the segment in."""
        self._board = board
        board.host(self.number, self._receive, self._begin, partial(self._plug, board))

    def _plug(self, board: Board) -> None:
        """Give each device its ways to the bus."""
        self._takers = [(each, board.guard(each.ecu, each.ecu.receive)) for each in self.stations]
        self._senders = [
            (each, *board.connect(each.ecu, partial(self._emit, each))) for each in self.stations
        ]

    def start(self, now: int) -> None:
        """Power all devices on at `now` [ns]."""
        for station in self.stations:
            station.ecu.start(now)

    def advance(self, now: int) -> None:
        """Let the devices act, and send what is due."""
        for station, send, release in self._senders:
            if station.advance is not None:
                station.advance(now)
            station.ecu.serve(now, send)
            if release is not None:
                release()
        self._heard, self._sent = self._sent, []

    def _begin(self, now: int) -> None:
        """Hand over what the devices have sent in the last round."""
        heard, self._heard = self._heard, []
        for sender, frame in heard:
            for station, take in self._takers:
                if station is not sender:
                    take(frame, now)

    def _receive(self, frame: Frame, now: int) -> None:
        for _, take in self._takers:
            take(frame, now)

    def _emit(self, station: EcuStation, frame: Frame) -> None:
        if self.number:
            frame = frame._replace(bus=self.number)
        if len(self.stations) > 1:
            self._sent.append((station, frame))
        if self._board is not None:
            self._board.emit(frame)


def build_ecus(
    configs: Sequence[EcuConfig], buses: Iterable[str], surroundings: Surroundings
) -> "EcuTable":
    """Return the J1939 devices of a bench.

    Args:
        configs: of the devices.
        buses: the names of the buses, in the order of their numbers.
        surroundings: what the devices may know of the bench.
    """
    stations: dict[int, list[EcuStation]] = {}
    fittings: dict[str, Fitting] = {}
    numbers = {name: number for number, name in enumerate(buses)}
    for each in configs:
        ecu = Ecu(each.identity, each.address)
        if each.component:
            component = each.component.encode("latin-1", "replace")
            ecu.provide(COMPONENT, lambda component=component: component)  # type: ignore[misc]
        fitting, signals, values = each.kind.fit(each, ecu, surroundings)
        station = EcuStation(each.name, ecu, fitting.advance, dict(signals), dict(values))
        stations.setdefault(numbers[each.bus], []).append(station)
        fittings[each.name] = fitting
    return EcuTable([Segment(number, those) for number, those in stations.items()], fittings)


class EcuHandle:
    """A J1939 device of a bench in a test: ``bench.ecus["joystick"]["x"] = -50``.

    Args:
        station: the device.

    Attributes:
        ecu: its ECU, with address claim, transport and trouble codes.
    """

    def __init__(self, station: EcuStation) -> None:
        self.ecu: Ecu = station.ecu
        self._station = station

    @property
    def address(self) -> int:
        """The source address that it has claimed; 254 for none."""
        return self.ecu.address

    @property
    def trouble_codes(self) -> list[TroubleCode]:
        """The trouble codes that are active, SPN and FMI."""
        return self.ecu.diagnostics.active

    def standing(self) -> dict[str, object]:
        """Return the status of the device: address claim, address, codes as SPN and FMI."""
        codes = [[code.spn, code.fmi] for code in self.trouble_codes]
        return {"state": self.ecu.state.value, "address": self.address, "codes": codes}

    @property
    def values(self) -> Mapping[str, EcuValue]:
        """The values that the device shows, by name."""
        return self._station.values

    def __iter__(self) -> Iterator[str]:
        return iter(self._station.values)

    def __contains__(self, name: object) -> bool:
        return name in self._station.values

    def __getitem__(self, name: str) -> float:
        """Return a signal in its own unit; NaN for an error or "not available"."""
        return self._reach(name).read()

    def __setitem__(self, name: str, value: float) -> None:
        """Set a signal that nothing else moves, in its own unit; NaN shows the error indicator."""
        found = self._reach(name)
        self.check(name, value)
        if found.takes is not None:
            found.takes(float(value))

    def check(self, name: str, value: object) -> None:
        """Refuse what a signal cannot be set to.

        Raises:
            ConfigError: it says why.
        """
        found, place = self._find(name), f"j1939.{self._station.name}: {name}"
        if found.takes is None:
            right = "give one without source, script and follow"
            raise ConfigError(f"{place} is what the device itself shows; {right}")
        is_number = isinstance(value, Real) and not isinstance(value, str)
        if not is_number or not (math.isnan(value) or found.low <= value <= found.high):  # type: ignore[arg-type, operator]
            unit = "" if found.unit == ONE.symbol else f" {found.unit}"
            right = f"give {found.low:g} to {found.high:g}{unit}"
            raise ConfigError(f"{place} cannot be {value!r}; {right}")

    def _reach(self, name: str) -> EcuValue:
        """Return a value of a device that has power.

        Raises:
            ConfigError: it has no power, or no such value.
        """
        found = self._find(name)
        if self._station.ecu.state is ClaimState.OFF:
            raise ConfigError(f"j1939.{self._station.name}: {name}: the device has no power")
        return found

    def _find(self, name: str) -> EcuValue:
        known = self._station.values
        if name not in known:
            right = f"give one of {', '.join(known)}" if known else "it has none"
            wrong = f'there is no signal "{name}"'
            raise ConfigError(f"j1939.{self._station.name}: {wrong}; {right}")
        return known[name]


class EcuTable(Peers):
    """The J1939 devices of a bench by their names, each an `EcuHandle`.

    Args:
        segments: the devices of each bus that has some.
        fittings: what each does, by its name.

    Attributes:
        segments: as passed in.
    """

    def __init__(self, segments: Sequence[Segment], fittings: Mapping[str, Fitting]) -> None:
        self.segments, self.fittings = tuple(segments), fittings
        self._stations = {
            station.name: station for segment in segments for station in segment.stations
        }
        super().__init__((name, EcuHandle(station)) for name, station in self._stations.items())

    def join(self, bench: Bench) -> None:
        """Plug the devices in."""
        for segment in self.segments:
            segment.join(bench.switchboard)
            bench.starts.append(segment.start)
            bench.acts.append(segment.advance)

    def add_points(self, points: Any, buses: Mapping[str, int]) -> None:  # noqa: ANN401 - of faults
        """Add the points at which faults act on them."""
        from hil_bench.abilities.j1939.fault_kinds import add_points  # noqa: PLC0415 - of faults

        for name, station in self._stations.items():
            add_points(points, name, station.ecu, station.signals, buses[name])
