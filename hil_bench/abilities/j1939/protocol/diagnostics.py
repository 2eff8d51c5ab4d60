"""Trouble codes of a device: DM1, DM2 and DM3 of SAE J1939-73."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Final, NamedTuple

from hil_bench.canopen_device.agenda import NEVER

CYCLE: Final = 1_000_000_000
"""From one DM1 to the next while a code is active, and the least time that one is [ns]."""

MOST_CODES: Final = 32
HIGHEST_SPN: Final = 0x7FFFF
HIGHEST_FMI: Final = 31

_MOST_COUNTED: Final = 126
_NO_FLASH: Final = 0xFF
_NO_CODE: Final = bytes(4)
_FILL: Final = b"\xff\xff"


class Lamp(IntEnum):
    """A lamp, with the place of its two bits in a DM1."""

    PROTECT = 0
    WARNING = 2
    STOP = 4
    MALFUNCTION = 6


class TroubleCode(NamedTuple):
    """A diagnostic trouble code.

    Attributes:
        spn: number of the parameter, 0 to 524287.
        fmi: failure mode, 0 to 31.
    """

    spn: int
    fmi: int


@dataclass(slots=True)
class _Occurrence:
    """A code that is or was active.

    Attributes:
        lamp: which it lights; None for none.
        count: how often it became active.
        since: when it last did [ns].
        reasons: how many say that it is active.
    """

    lamp: Lamp | None
    count: int = 0
    since: int = 0
    reasons: int = 0


class Diagnostics:
    """The codes of one device.

    Attributes:
        due: when a DM1 is to be sent [ns].
    """

    def __init__(self) -> None:
        self.due = NEVER
        self._active: dict[TroubleCode, _Occurrence] = {}
        self._previous: dict[TroubleCode, _Occurrence] = {}

    @property
    def active(self) -> list[TroubleCode]:
        """The codes that are active."""
        return list(self._active)

    def reset(self) -> None:
        """Begin anew: what is wrong still is, and is said again."""
        self._previous = {}
        self.due = 0 if self._active else NEVER

    def begin(self, code: TroubleCode, lamp: Lamp | None, now: int) -> None:
        """Make a code active; as often as `end` must be called to end it."""
        found = self._active.get(code)
        if found is None:
            if len(self._active) >= MOST_CODES:
                return
            found = self._previous.pop(code, None) or _Occurrence(lamp)
            found.lamp, found.since = lamp, now
            found.count = min(found.count + 1, _MOST_COUNTED)
            self._active[code] = found
            self.due = min(self.due, now)
        found.reasons += 1

    def end(self, code: TroubleCode, now: int) -> None:
        """Take one reason for a code away; it stays active for a second at least."""
        found = self._active.get(code)
        if found is not None and found.reasons:
            found.reasons -= 1
            if not found.reasons:
                self.due = min(self.due, max(now, found.since + CYCLE))

    def expire(self, now: int) -> None:
        """Move the codes whose reasons are gone to the previous ones, and time the next DM1."""
        for code, each in list(self._active.items()):
            if not each.reasons and now >= each.since + CYCLE:
                self._previous[code] = self._active.pop(code)
        while len(self._previous) > MOST_CODES:
            del self._previous[next(iter(self._previous))]
        self.due = now + CYCLE if self._active else NEVER

    def clear_previous(self) -> None:
        """Forget the codes that are no longer active (DM3)."""
        self._previous = {}

    def dm1(self) -> bytes:
        """Return the message of the active codes: lamps, then each code."""
        return self._message(self._active)

    def dm2(self) -> bytes:
        """Return the message of the codes that were active: the present lamps, then each code."""
        return self._message(self._previous)

    def _message(self, codes: dict[TroubleCode, _Occurrence]) -> bytes:
        lamps = 0
        for each in self._active.values():
            if each.lamp is not None:
                lamps |= 1 << each.lamp
        listed = b"".join(_pack(code, each.count) for code, each in codes.items()) or _NO_CODE
        message = bytes((lamps, _NO_FLASH)) + listed
        return message + _FILL if len(message) < 8 else message


def _pack(code: TroubleCode, count: int) -> bytes:
    """Return a code and its occurrence count, by conversion method 4."""
    spn, fmi = code
    return bytes((spn & 0xFF, spn >> 8 & 0xFF, spn >> 16 << 5 | fmi, count))
