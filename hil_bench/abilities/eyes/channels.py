"""Channels of a recording in SI: PDOs, J1939 messages of known devices, messages of a DBC file."""

import math
import re
from collections import deque
from collections.abc import Iterable, Iterator
from typing import Final, NamedTuple

from hil_bench.abilities.eyes.dbc_words import DbcMessages
from hil_bench.abilities.eyes.known_ecu import KnownEcu, KnownValue
from hil_bench.abilities.eyes.known_node import PdoOwner
from hil_bench.abilities.eyes.pdos import PdoField
from hil_bench.abilities.eyes.sight import J1939Message, Sight
from hil_bench.abilities.eyes.values import Reading
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import Channel
from hil_bench.units import COUNT, read_unit, si_unit

MOST_LATE: Final = 10
"""Ticks that a value may stand behind its frame."""

_LEAST_HOLD: Final = 100_000_000  # [ns]
_HELD_INTERVALS: Final = 3
_NO_WORD: Final = re.compile(r"[^0-9A-Za-z]+")

_Key = tuple[int, int, int, int]
"""Bus, node-ID, index and sub-index."""


class _Heard(NamedTuple):
    """A value, and the time of its frame [ns]."""

    value: float
    time: float


_UNHEARD: Final = _Heard(math.nan, -math.inf)


def symbol_of(name: str) -> str:
    """Return the name of an object as one word, as in ``spool_actual_value``."""
    return word_of(name).lower()


def word_of(name: str) -> str:
    """Return a name as one word, in its own case."""
    return _NO_WORD.sub("_", name.strip()).strip("_")


class BusChannels:
    """Holds each number that a PDO or a J1939 message carries, until it is too old to count.

    Args:
        owners: the PDOs.
        ecus: the J1939 devices.
        dbc: the messages of all other frames.
        hold: how long a value counts [ns]; without it three times the shortest time between two
            of its values so far, and 100 ms at least.

    Attributes:
        channels: one an object with numbers, its name is node and object; and one a J1939 signal.
        missed: values that came of objects without a channel: mapped after the recording began.
    """

    def __init__(
        self,
        owners: Iterable[PdoOwner],
        ecus: Iterable[KnownEcu] = (),
        dbc: DbcMessages | None = None,
        hold: int | None = None,
    ) -> None:
        self._hold = hold
        self._dbc = dbc or DbcMessages(None)
        self._signals: dict[tuple[str, str], tuple[int, float]] = {}
        self.missed = 0
        self.channels: list[Channel] = []
        self._places: dict[_Key, tuple[int, float]] = {}
        self._told: dict[tuple[int, int], list[tuple[int, str, KnownValue]]] = {}
        self._values: list[_Heard] = []
        self._intervals: list[float] = []  # the shortest of each channel [ns]
        self._names: set[str] = set()
        for owner in owners:
            for field in owner.pdo.fields:
                self._add(owner, field)
        for ecu in ecus:
            for value in ecu.values:
                place = self._open(f"{ecu.name}.{value.name}", f"PGN_{value.group}", value.unit)
                told = self._told.setdefault((ecu.bus, value.group), [])
                told.append((place, ecu.name, value))
        for message, signal, unit in self._dbc.signals():
            symbol, factor = si_unit(unit)
            name = f"{word_of(message)}.{word_of(signal)}"
            self._signals[message, signal] = self._open(name, "dbc", symbol), factor

    def _add(self, owner: PdoOwner, field: PdoField) -> None:
        reader, node = field.reader, owner.node
        key = node.bus, node.node_id, reader.index, reader.subindex
        if key in self._places or not _is_number(field):
            return
        place = f"0x{reader.index:04X}_{reader.subindex:02X}"
        name = f"{symbol_of(node.name)}.{symbol_of(reader.name) or place}"
        symbol, factor = COUNT, 1.0
        if reader.scale is not None:
            symbol, factor = _si_symbol(reader.scale.unit.symbol), reader.scale.unit.factor
        self._places[key] = self._open(name, place, symbol), factor

    def _open(self, name: str, place: str, unit: str) -> int:
        """Open a channel, and return its number; its place tells it from another of its name."""
        if name in self._names:
            name = f"{name}_{place}"
        self._names.add(name)
        self.channels.append(Channel(name, unit))
        self._values.append(_UNHEARD)
        self._intervals.append(math.inf)
        return len(self.channels) - 1

    def take(self, sight: Sight, now: int) -> dict[int, float]:
        """Hold the values of a frame that came at a time [ns].

        Returns:
            The number of each channel of which it has a value, and that [SI].
        """
        found = dict(self._numbers(sight))
        for number, value in found.items():
            interval = now - self._values[number].time
            self._intervals[number] = min(self._intervals[number], interval)
            self._values[number] = _Heard(value, now)
        return found

    def hold(self, number: int) -> float:
        """Return the time for which a value of a channel counts [ns]."""
        if self._hold is not None:
            return self._hold
        interval = self._intervals[number]
        return max(_LEAST_HOLD, _HELD_INTERVALS * interval) if interval < math.inf else _LEAST_HOLD

    def _numbers(self, sight: Sight) -> Iterator[tuple[int, float]]:
        if sight.message is not None:
            yield from self._message_numbers(sight, sight.message)
        for reading in sight.readings:
            place = self._places.get(_key(sight, reading))
            if place is None:
                self.missed += 1
            elif not isinstance(reading.value, str):
                number, factor = place
                yield number, reading.value * factor
        for signal, value in self._dbc.numbers(sight).items():
            number, factor = self._signals[signal]
            yield number, value * factor

    def _message_numbers(self, sight: Sight, message: J1939Message) -> Iterator[tuple[int, float]]:
        """Yield what its sender says with it, and what it says to those whom it is meant for."""
        if message.data is None:
            return
        for place, device, value in self._told.get((sight.frame.bus, message.group), ()):
            if device == sight.node if value.is_sent else message.receiver in {"", device}:
                yield place, value.read(message.data)

    def row(self, now: int) -> tuple[float, ...]:
        """Return a row of a recording: time [s], and each value, NaN where it does not count."""
        return now * 1e-9, *(self.held(*each, now) for each in enumerate(self._values))

    def held(self, number: int, heard: _Heard, now: int) -> float:
        """Return a value of a channel at a time [ns], NaN where it does not count any more."""
        return heard.value if now - heard.time <= self.hold(number) else math.nan


class TickRows:
    """Makes rows at even ticks of what is heard, in which a value that grew old is unknown.

    A value stands in the first tick at or behind its frame, and in those after it for as long as it
    is held. No value is left out: a second one within a tick stands in the next. Where all are
    unknown there is no row.

    Args:
        channels: what is heard, and how long it counts.
        tick: time between two rows [ns].

    Attributes:
        late: how late a value stands at most, beside the part of a tick that rounding makes [ns].
    """

    def __init__(self, channels: BusChannels, tick: int) -> None:
        self._channels, self._tick = channels, tick
        self._waiting: list[deque[_Heard]] = [deque() for _ in channels.channels]
        self._last = [_UNHEARD] * len(channels.channels)
        self._next = 0  # [ns]
        self.late = 0

    def take(self, sight: Sight, now: int) -> None:
        """Take the values of a frame that came at a time [ns], behind the last row."""
        for number, value in self._channels.take(sight, now).items():
            waiting = self._waiting[number]
            if waiting and waiting[-1].value == value:
                waiting.pop()
            waiting.append(_Heard(value, now))

    def rows(self, until: int) -> Iterator[tuple[float, ...]]:
        """Yield the rows of all ticks before a time [ns]: time [s], and the values."""
        while self._next < until:
            row = [self._value(number) for number in range(len(self._last))]
            if any(map(math.isfinite, row)):
                yield self._next * 1e-9, *row
                self._next += self._tick
            else:  # nothing is known until the frame that comes
                self._next = -(-until // self._tick) * self._tick

    def _value(self, number: int) -> float:
        """Return the value of a channel at the next tick.

        Raises:
            ConfigError: it is many ticks old, as others stood before it.
        """
        if waiting := self._waiting[number]:
            self._last[number] = waiting.popleft()
            late = int(self._next - self._last[number].time) - self._tick
            if late > MOST_LATE * self._tick:
                name = self._channels.channels[number].name
                raise ConfigError(
                    f"{name} has more values than ticks of {self._tick / 1e6:g} ms around "
                    f"{self._next / 1e9:.6g} s; give a shorter --tick"
                )
            self.late = max(self.late, late)
        return self._channels.held(number, self._last[number], self._next)


def _key(sight: Sight, reading: Reading) -> _Key:
    return sight.frame.bus, sight.node_id or 0, reading.object_index, reading.subindex


def _si_symbol(symbol: str) -> str:
    """Return the unit of a value times its unit's factor; CiA 303-2 has prefixes, as in hbar."""
    found = read_unit(symbol) or read_unit(symbol[1:]) or read_unit(symbol.removeprefix("da"))
    return symbol if found is None else found.symbol


def _is_number(field: PdoField) -> bool:
    data_type = field.reader.data_type
    return data_type is not None and not isinstance(data_type.zero, (str, bytes))
