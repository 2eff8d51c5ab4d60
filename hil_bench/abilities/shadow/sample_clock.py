"""When a value that comes in a PDO was measured, as far as the frames of a bus show."""

from collections import deque
from collections.abc import Callable, Iterable
from typing import NamedTuple

import can

from hil_bench.abilities.shadow.punctuality import PdoPunctuality

_SYNC = 0x080
_EVIDENCE = 8
"""Frames of a PDO by which it is judged."""
_UNKNOWN_PERIOD = 0.01
"""SYNC period before the second SYNC [s]."""
_TRANSFER = 2e-3
"""What a device and its bus may take between measuring and sending, or to act on a command [s]."""
_CYCLE = 1e-3
"""How much earlier a command may act than the twin, which acts in ticks of its own, thinks [s]."""


class SampleTime(NamedTuple):
    """When a value was measured.

    Attributes:
        earliest: not before this [s].
        likely: the SYNC's time if the PDO follows SYNC, that of the frame if not [s].
        frame: the time of its frame [s].
        latest: up to this time of the twin, whose ticks are not those of the device [s].
        lateness: how much later than usual the frame came [s].
    """

    earliest: float
    likely: float
    frame: float
    latest: float
    lateness: float


class SampleClock:
    """Tells PDOs that follow SYNC from those that come by themselves.

    A device measures at SYNC, and its synchronous PDO waits for the bus among those of all the
    others (CiA 301, 7.5.2.16). Whether a PDO is synchronous may have been set before anybody
    listened. So it counts as synchronous while its last frames say nothing against it: each the
    first of its kind after a SYNC, and at once, or within half of the SYNC's period where it is
    known to be synchronous. If that is wrong, the time of the frame is still among those that are
    looked at.

    Args:
        identifiers: of the PDOs that are looked at.
        is_synchronous: whether a PDO is known to be.
    """

    def __init__(self, identifiers: Iterable[int], is_synchronous: Callable[[int], bool]) -> None:
        self._is_synchronous = is_synchronous
        self._synced_at: float | None = None
        self._period = _UNKNOWN_PERIOD
        self._since_sync: set[int] = set()
        self._in_step = {pdo: deque[bool](maxlen=_EVIDENCE) for pdo in identifiers}
        self._punctuality = {pdo: PdoPunctuality() for pdo in self._in_step}

    def take(self, message: can.Message, time: float) -> SampleTime:
        """Take a frame, and return when its values were measured.

        Args:
            message: the frame.
            time: when it was on the bus [s].
        """
        identifier = message.arbitration_id
        if identifier == _SYNC and not message.is_extended_id:
            self._synchronise(time)
        if identifier not in self._in_step or message.is_extended_id or message.is_remote_frame:
            return _sample_time(time, time, 0.0)
        lateness = self._punctuality[identifier].take(time)
        synced_at = self._synced_at
        if synced_at is not None and self._follows_sync(identifier, time - synced_at):
            return _sample_time(synced_at, time, lateness)
        return _sample_time(time, time, lateness)

    def _synchronise(self, time: float) -> None:
        if self._synced_at is not None:
            self._period = time - self._synced_at
        self._synced_at = time
        self._since_sync.clear()
        for pdo in self._punctuality.values():
            pdo.synchronise(time)

    def _follows_sync(self, identifier: int, delay: float) -> bool:
        is_first = identifier not in self._since_sync
        self._since_sync.add(identifier)
        longest = 0.5 * self._period
        if not self._is_synchronous(identifier):
            longest = min(longest, _TRANSFER)
        evidence = self._in_step[identifier]
        evidence.append(is_first and delay <= longest)
        return all(evidence)


def _sample_time(likely: float, frame: float, lateness: float) -> SampleTime:
    earliest = min(likely, frame - _TRANSFER)
    return SampleTime(earliest, likely, frame, frame + _CYCLE, lateness)
