"""SYNC: its period, its gaps, its jitter, its producers, and what 0x1006 and 0x1019 say of it."""

from collections import deque
from collections.abc import Iterable, Iterator
from itertools import pairwise
from statistics import fmean, median
from typing import Final, NamedTuple

from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.explain.finding import (
    Cause,
    Evidence,
    Finding,
    finding,
    milliseconds,
    seconds,
)
from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.abilities.eyes.sight import Service, Sight
from hil_bench.canopen_device.nmt import NmtCommand, NmtRequest

# Two producers of SYNC: every other one comes with a period, and the sequence of all with none.

_LENGTH: Final = 32
"""Intervals that are looked at together ..."""
_EVERY: Final = 8
"""... and SYNCs between two looks."""

_EVEN: Final = 0.06
_ALIKE: Final = 0.2
"""How far intervals may be off for a period, of it: those of every other SYNC, those of all."""

_MANY: Final = 0.8
_FEW: Final = 0.6
_DRIFT: Final = 0.03
"""Change of the time between the two from third to third of a look [periods]: two clocks."""


class Producers(NamedTuple):
    """Two producers.

    Attributes:
        sight: the first SYNC of the look that showed them.
        period: of each of them [ns].
    """

    sight: Sight
    period: float


class SyncProducers:
    """Follows the times of SYNC.

    Attributes:
        found: the two producers, once there was proof; None before.
    """

    def __init__(self) -> None:
        self.found: Producers | None = None
        self._sights: deque[Sight] = deque(maxlen=_LENGTH + 1)
        self._count = 0
        self._settled = 0.0

    def hear(self, sight: Sight, periods: Iterable[float]) -> None:
        """Take a SYNC.

        Args:
            sight: the SYNC.
            periods: those that nodes were given by 0x1006 [ns].
        """
        self._sights.append(sight)
        self._count += 1
        is_due = len(self._sights) > _LENGTH and self._count % _EVERY == 0
        if is_due and self.found is None:
            self._look(periods)

    def _look(self, periods: Iterable[float]) -> None:
        times = [sight.now for sight in self._sights]
        ones = [after - before for before, after in pairwise(times)]
        twos = [after - before for before, after in zip(times, times[2:], strict=False)]
        middle, period = median(ones), median(twos)
        if _share(ones, middle, _ALIKE) >= _MANY:
            self._settled = middle
            return
        if _share(twos, period, _EVEN) < _MANY or _share(ones, period / 2, _ALIKE) >= _FEW:
            return
        known = self._settled, *periods
        is_known = any(abs(each - period) <= _ALIKE / 2 * period for each in known)
        if is_known or _drifts(ones[::2], _DRIFT * period):
            self.found = Producers(self._sights[0], period)


def _share(intervals: list[int], period: float, tolerance: float) -> float:
    alike = sum(abs(each - period) <= tolerance * period for each in intervals)
    return alike / len(intervals)


def _drifts(phases: list[int], step: float) -> bool:
    """Return True if times become longer and longer, or shorter and shorter."""
    third = len(phases) // 3
    first, second, last = (median(phases[k * third : (k + 1) * third]) for k in range(3))
    return min(second - first, last - second) > step or max(second - first, last - second) < -step


_FEWEST = 5
_SURE = 20
"""Periods after which the period of SYNC is held against 0x1006."""

_OFF = 0.15
_NS_PER_US = 1000
_MISSED = 1.7
_LOST = 5.0
"""Periods after which SYNC has stopped, where the rest of the bus goes on ..."""
_SHUTDOWN = 1_000_000_000
"""... for longer than this: before, its producer may be ending in whatever order [ns].

Whoever takes all nodes out of OPERATIONAL needs no SYNC."""

_WRONG_LENGTH = 0x8240
"""EMCY code of a SYNC with a counter that is not expected, or without the one that is."""

_JITTER = 0.2
_JITTERY_SHARE = 0.05


class Syncs:
    """Watches the period of SYNC.

    Args:
        decoder: that gives the sights.
    """

    hears = frozenset({Service.NMT, Service.SYNC, Service.EMCY})

    def __init__(self, decoder: Decoder) -> None:
        self._decoder = decoder
        self._recent: deque[int] = deque(maxlen=21)
        self._last: Sight | None = None
        self._counter: int | None = None
        self._due_from = 0
        self._missed: tuple[Sight, Sight] | None = None
        self._misses = 0
        self._jumps = Evidence()
        self._jittery = 0
        self._first_jittery: Sight | None = None
        self._worst: tuple[float, Sight] | None = None
        self._count = 0
        self._is_over = False
        self._producers = SyncProducers()
        self._disputed = Evidence()

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        if sight.service is Service.NMT:
            request = NmtRequest.parse(sight.frame.data)
            if request is not None and request.node_id == 0:
                self._is_over = request.command is not NmtCommand.START
        if sight.emcy_code == _WRONG_LENGTH:
            self._disputed.append(sight)
        if sight.service is not Service.SYNC or sight.frame.is_remote:
            return
        self._producers.hear(sight, (own for _, own in self._given(sight.frame.bus)))
        self._is_over = False
        self._count += 1
        self._hear_counter(sight)
        if self._last is not None:
            self._hear_interval(self._last, sight)
        self._last, self._due_from = sight, sight.now

    def pause(self, length: int) -> None:
        """Count from the end of a pause."""
        self._due_from += length

    def findings(self, end: int) -> Iterator[Finding]:
        """Yield what is wrong with SYNC.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """
        yield from self._setting_findings()
        period = self._period()
        silence = 0 if self._last is None or self._is_over else end - self._due_from
        if self._last is not None and period and silence > max(_LOST * period, _SHUTDOWN):
            text = f"SYNC stops at {seconds(self._last.now)} (every {milliseconds(period)} before)"
            yield Finding(Cause.SYNC_MISSING, "", self._last.now, text, (self._last,))
        elif self._missed is not None:
            before, after = self._missed
            text = f"no SYNC for {milliseconds(after.now - before.now)} after {seconds(before.now)}"
            text += f" (every {milliseconds(period)}); {self._misses} such gaps"
            yield Finding(Cause.SYNC_MISSING, "", before.now, text, (before, after))
        elif self._jumps:
            text = (
                f"the SYNC counter jumps {self._jumps.total} times: frames lost, or two producers"
            )
            yield finding(Cause.SYNC_MISSING, "", self._jumps, text)
        if self._jittery > max(2, _JITTERY_SHARE * self._count) and self._worst is not None:
            worst, sight = self._worst
            text = (
                f"SYNC is up to {milliseconds(worst)} off its period of {milliseconds(period)}, "
                f"{self._jittery} of {self._count} more than {_JITTER:.0%}"
            )
            first = self._first_jittery or sight
            yield Finding(Cause.SYNC_JITTER, "", first.now, text, (sight,))
        yield from self._period_findings(period)

    def _setting_findings(self) -> Iterator[Finding]:
        """Yield that two devices produce SYNC, and that nodes reject its length."""
        if self._producers.found is not None:
            first, period = self._producers.found
            text = f"two devices send SYNC, each every {milliseconds(period)}, from "
            text += f"{seconds(first.now)} on"
            yield Finding(Cause.SYNC_TWICE, "", first.now, text, (first,))
        if self._disputed and self._last is not None:
            names = ", ".join(dict.fromkeys(sight.node for sight in self._disputed))
            has = "a counter" if self._last.frame.data else "no counter"
            text = f"SYNC has {has}, and {names} expect{'s' * (',' not in names)} another length "
            text += "(0x1019)"
            yield finding(Cause.SYNC_COUNTER, "", self._disputed, text)

    def _given(self, bus: int) -> Iterator[tuple[KnownNode, float]]:
        """Yield the nodes that were given a period by 0x1006, and the period [ns]."""
        for node in self._decoder.nodes.values():
            written = node.objects.find(0x1006)
            own = node.number(0x1006) * _NS_PER_US
            if node.bus != bus or written is None or not own:
                continue
            if not node.has_eds or written.value != written.default or node.produces_sync:
                yield node, own

    def _period_findings(self, period: float) -> Iterator[Finding]:
        """Yield the nodes that were given another period (0x1006) than SYNC has."""
        last = self._last
        if last is None or len(self._recent) < _SURE:
            return
        for node, own in self._given(last.frame.bus):
            if abs(period - own) > _OFF * own:
                text = f"SYNC comes every {milliseconds(period)}, and 0x1006 of {node.name} says "
                text += milliseconds(own)
                yield Finding(Cause.SYNC_PERIOD, "", last.now, text, (last,))
                return

    def _period(self) -> float:
        return fmean(self._recent) if len(self._recent) >= _FEWEST else 0.0

    def _hear_interval(self, last: Sight, sight: Sight) -> None:
        interval, period = sight.now - self._due_from, self._period()
        if period and interval > _MISSED * period:
            self._missed, self._misses = self._missed or (last, sight), self._misses + 1
            return
        if period and (off := abs(interval - period)) > _JITTER * period:
            self._jittery += 1
            self._first_jittery = self._first_jittery or sight
            if self._worst is None or off > self._worst[0]:
                self._worst = off, sight
        self._recent.append(interval)

    def _hear_counter(self, sight: Sight) -> None:
        counter = sight.frame.data[0] if len(sight.frame.data) == 1 else None
        before, self._counter = self._counter, counter
        if counter is not None and before is not None and counter not in {before + 1, 1}:
            self._jumps.append(sight)
