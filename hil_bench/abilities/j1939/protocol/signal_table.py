"""A device on J1939 by table: the signals that it sends, and those that command an axis."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

from hil_bench.abilities.j1939.protocol.ecu import Ecu
from hil_bench.abilities.j1939.protocol.signals import Signal

_LEAST_BYTES: Final = 8


class Show(StrEnum):
    """The part of its value that a signal shows, as the messages of joysticks have it."""

    VALUE = "value"
    SIZE = "size"
    NEGATIVE = "negative"
    POSITIVE = "positive"
    NEUTRAL = "neutral"


class Indication(StrEnum):
    """An indicator in place of a signal's value."""

    ERROR = "error"
    NOT_AVAILABLE = "not_available"


_SHOWN: Final[dict[Show, Callable[[float, float], float]]] = {
    Show.VALUE: lambda value, _: value,
    Show.SIZE: lambda value, _: abs(value),
    Show.NEGATIVE: lambda value, least: float(value <= -least),
    Show.POSITIVE: lambda value, least: float(value >= least),
    Show.NEUTRAL: lambda value, least: float(abs(value) < least),
}
"""What each shows of a value; one below the second number is neutral."""


@dataclass(slots=True, eq=False)
class SentSignal:
    """A signal that a device sends.

    Attributes:
        signal: its place.
        show: what of its value.
        neutral: a value below this one is neutral.
        trouble: SPN and FMI of the trouble code that an error indicator raises; None for none.
        value: what it shows now; NaN is the error indicator.
        indications: what stands in place of the value, the newest last.
    """

    signal: Signal
    show: Show = Show.VALUE
    neutral: float = 0.0
    trouble: tuple[int, int] | None = None
    value: float = 0.0
    indications: list[Indication] = field(default_factory=list)

    @property
    def is_error(self) -> bool:
        """True if the signal shows the error indicator."""
        if self.indications:
            return self.indications[-1] is Indication.ERROR
        return math.isnan(self.value)

    @property
    def shown(self) -> float:
        """The value shown, of a direction 0 or 1; NaN where it shows no value."""
        if self.indications or math.isnan(self.value):
            return math.nan
        if self.show is Show.SIZE:
            return self.value
        return _SHOWN[self.show](self.value, self.neutral)

    @property
    def limits(self) -> tuple[float, float]:
        """The least and the largest value that it can show."""
        ends = self.signal.offset, self.signal.offset + self.signal.highest * self.signal.resolution
        match self.show:
            case Show.VALUE:
                return min(ends), max(ends)
            case Show.SIZE:
                return -max(ends), max(ends)
            case _:
                return -math.inf, math.inf

    @property
    def raw(self) -> int:
        """The raw value that is sent."""
        if self.indications:
            is_error = self.indications[-1] is Indication.ERROR
            return self.signal.error if is_error else self.signal.not_available
        if math.isnan(self.value):
            return self.signal.error
        return self.signal.raw(_SHOWN[self.show](self.value, self.neutral))


@dataclass(slots=True)
class SentGroup:
    """A parameter group that a device sends.

    Attributes:
        group: its PGN.
        period: between two [ns]; 0 for on request alone.
        priority: of its frames.
        signals: what is in it; all other bits are 1.
    """

    group: int
    period: int
    priority: int
    signals: list[SentSignal]

    def make(self) -> bytes:
        """Return the data with the present values; at least 8 bytes."""
        bits = max(each.signal.start + each.signal.length for each in self.signals)
        length = max(_LEAST_BYTES, -(-bits // 8))
        message = (1 << 8 * length) - 1
        for each in self.signals:
            message = each.signal.put(message, each.raw)
        return message.to_bytes(length, "little")


@dataclass(slots=True)
class Input:
    """A value that a test sets.

    Attributes:
        value: what it is now.
    """

    value: float

    def value_at(self, time: float) -> float:  # noqa: ARG002 - a course that stands
        """Return the value, at any time."""
        return self.value

    def take(self, value: float) -> None:
        """Have another value from now on."""
        self.value = value


class CommandSignal:
    """A received signal that commands an axis, in place of a valve.

    It obeys from its first valid value on, until none has come for `timeout`, or the error
    indicator or "not available" comes.

    Args:
        signal: its place.
        scale: value of the signal for 100 %.
        safe: command while nobody commands, as a part of the full opening.
        timeout: longest time between two messages [ns]; 0 for any.
        full_opening: command of 100 % [SI].

    Attributes:
        full_opening: as passed in.
    """

    def __init__(
        self, signal: Signal, *, scale: float, safe: float, timeout: int, full_opening: float
    ) -> None:
        self.full_opening = full_opening
        self._signal, self._scale, self._timeout = signal, scale, timeout
        self._safe = self._share = safe
        self._deadline: int | None = None

    def take(self, data: bytes, now: int) -> None:
        """Take a message of its group."""
        value = self._signal.value(data)
        self._share = self._safe if math.isnan(value) else max(-1.0, min(1.0, value / self._scale))
        self._deadline = now + self._timeout if self._timeout else None

    def command(self, now: int) -> float:
        """Return the command at `now` [ns], in SI."""
        if self._deadline is not None and now >= self._deadline:
            self._share, self._deadline = self._safe, None
        return self._share * self.full_opening

    def publish(self, answer: float, now: int) -> None:
        """Take what follows the command, which such a device does not show by itself."""


class SignalTable:
    """The signals of one device.

    Args:
        ecu: that carries them on the bus.
        groups: what it sends.
        commands: what commands axes, with its PGN.
    """

    def __init__(
        self, ecu: Ecu, groups: Iterable[SentGroup], commands: Iterable[tuple[int, CommandSignal]]
    ) -> None:
        self._ecu = ecu
        self._watched: list[tuple[SentSignal, tuple[int, int]]] = []
        self._failed: set[SentSignal] = set()
        for group in groups:
            ecu.provide(group.group, group.make, period=group.period, priority=group.priority)
            self._watched += [(each, each.trouble) for each in group.signals if each.trouble]
        takers: dict[int, list[CommandSignal]] = {}
        for number, command in commands:
            takers.setdefault(number, []).append(command)
        for number, taking in takers.items():
            ecu.take(number, _hand_to(taking))

    def advance(self, now: int) -> None:  # noqa: ARG002 - the trouble codes have the ECU's time
        """Begin and end the trouble codes of signals that show the error indicator."""
        for signal, trouble in self._watched:
            if signal.is_error == (signal in self._failed):
                continue
            if signal.is_error:
                self._failed.add(signal)
                self._ecu.begin_trouble(*trouble)
            else:
                self._failed.remove(signal)
                self._ecu.end_trouble(*trouble)


def _hand_to(commands: list[CommandSignal]) -> Callable[[int, bytes, int], None]:
    def take(_source: int, data: bytes, now: int) -> None:
        for command in commands:
            command.take(data, now)

    return take
