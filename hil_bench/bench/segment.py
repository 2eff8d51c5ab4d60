"""The J1939 devices of a bench on one bus, and what they hear of each other."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

from hil_bench.bench.switchboard import Way
from hil_bench.canopen_device.frame import Emit, Frame, Handler
from hil_bench.devices.faults.line import Line
from hil_bench.devices.j1939.ecu import Ecu
from hil_bench.devices.j1939.signal_table import SentSignal
from hil_bench.devices.j1939.values import EcuValue


@dataclass(frozen=True, slots=True, eq=False)
class EcuStation:
    """A J1939 device at its bus.

    Attributes:
        name: as in the configuration.
        ecu: its ECU.
        line: its connection, where faults get at its frames.
        advance: what the device does in each tick [ns]; None where it has nothing to do.
        signals: what it sends and a fault may indicate, by name.
        values: what it shows, by name.
    """

    name: str
    ecu: Ecu
    line: Line
    advance: Callable[[int], None] | None
    signals: dict[str, SentSignal]
    values: dict[str, EcuValue]


class Board(Protocol):
    """The board that a segment is plugged into."""

    @property
    def emit(self) -> Emit:
        """Takes a frame that is sent."""

    def ways_of(self, device: object) -> Sequence[Way]:
        """Return the ways between the bus and a device, on a bus of copper its CAN controller."""

    def host(self, bus: int, take: Handler, begin: Callable[[int], None]) -> None:
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
        self._ways = [(each, each.line.guard(each.ecu.receive)) for each in self.stations]
        self._emits: list[tuple[EcuStation, Emit]] = [
            (each, partial(self._emit, each)) for each in self.stations
        ]

    def join(self, board: Board) -> None:
        """Plug the segment in, each device by its ways."""
        self._board = board
        for place, station in enumerate(self.stations):
            for way in board.ways_of(station.ecu):
                self._emits[place] = station, way.sender(self._emits[place][1])
                self._ways[place] = station, way.guard(self._ways[place][1])
        board.host(self.number, self._receive, self._begin)

    def start(self, now: int) -> None:
        """Power all devices on at `now` [ns]."""
        for station in self.stations:
            station.ecu.start(now)

    def advance(self, now: int) -> None:
        """Let the devices act, and send what is due."""
        for station, emit in self._emits:
            if station.advance is not None:
                station.advance(now)
            send = station.line.sender(emit) if station.line.meetings else emit
            station.ecu.serve(now, send)
            station.line.release(emit)
        self._heard, self._sent = self._sent, []

    def _begin(self, now: int) -> None:
        """Hand over what the devices have sent in the last round, and what was late."""
        heard, self._heard = self._heard, []
        for station in self.stations:
            station.line.deliver(now)
        for sender, frame in heard:
            for station, take in self._ways:
                if station is not sender:
                    take(frame, now)

    def _receive(self, frame: Frame, now: int) -> None:
        for _, take in self._ways:
            take(frame, now)

    def _emit(self, station: EcuStation, frame: Frame) -> None:
        if self.number:
            frame = frame._replace(bus=self.number)
        if len(self.stations) > 1:
            self._sent.append((station, frame))
        if self._board is not None:
            self._board.emit(frame)
