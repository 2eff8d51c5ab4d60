"""SYNC: its period, its gaps, its jitter, its producers, and what 0x1006 and 0x1019 say of it."""

from collections import deque
from collections.abc import Iterator
from statistics import fmean

from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.explain.finding import (
    Cause,
    Evidence,
    Finding,
    finding,
    milliseconds,
    seconds,
)
from hil_bench.abilities.eyes.explain.sync_producers import SyncProducers
from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.abilities.eyes.sight import Service, Sight
from hil_bench.canopen_device.nmt import NmtCommand, NmtRequest

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
