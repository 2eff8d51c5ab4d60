"""SYNC, EMCY and the load of a bus."""

from collections import deque
from collections.abc import Iterator
from statistics import fmean

from hil_bench.abilities.eyes.explain.finding import EVIDENCE, Cause, Finding, milliseconds, seconds
from hil_bench.abilities.eyes.sight import Service, Sight
from hil_bench.canopen_device.nmt import NmtCommand, NmtRequest
from hil_bench.canopen_device.words import emergency_text, is_error_reset
from hil_bench.frame import frame_bits, is_error_frame

_FEWEST = 5
_MISSED = 1.5
_LOST = 5.0
"""Periods after which SYNC has stopped, where the rest of the bus goes on ..."""
_SHUTDOWN = 1_000_000_000
"""... for longer than this: before, its producer may be ending in whatever order [ns].

Whoever takes all nodes out of OPERATIONAL needs no SYNC."""

_JITTER = 0.2
_JITTERY_SHARE = 0.05
_WINDOW = 100_000_000
_HIGH_LOAD = 0.8

EXPLAINED = {
    0x8130: Cause.HEARTBEAT_LOST,
    0x8210: Cause.PDO_LENGTH,
    0x8220: Cause.PDO_LENGTH,
    0x8250: Cause.RPDO_TIMEOUT,
}
"""EMCY codes that another finding tells with its reason."""


class Syncs:
    """Watches the period of SYNC."""

    def __init__(self) -> None:
        self._recent: deque[int] = deque(maxlen=21)
        self._last: Sight | None = None
        self._counter: int | None = None
        self._missed: list[tuple[Sight, Sight]] = []
        self._jumps: list[Sight] = []
        self._jitter: list[tuple[float, Sight]] = []
        self._count = 0
        self._is_over = False

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        if sight.service is Service.NMT:
            request = NmtRequest.parse(sight.frame.data)
            if request is not None and request.node_id == 0:
                self._is_over = request.command is not NmtCommand.START
        if sight.service is not Service.SYNC or sight.frame.is_remote:
            return
        self._is_over = False
        self._count += 1
        self._hear_counter(sight)
        if self._last is not None:
            self._hear_interval(self._last, sight)
        self._last = sight

    def findings(self, end: int) -> Iterator[Finding]:
        """Yield what is wrong with SYNC.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """
        period = self._period()
        silence = 0 if self._last is None or self._is_over else end - self._last.now
        if self._last is not None and period and silence > max(_LOST * period, _SHUTDOWN):
            text = f"SYNC stops at {seconds(self._last.now)} (every {milliseconds(period)} before)"
            yield Finding(Cause.SYNC_MISSING, "", self._last.now, text, (self._last,))
        elif self._missed:
            before, after = self._missed[0]
            text = f"no SYNC for {milliseconds(after.now - before.now)} after {seconds(before.now)}"
            text += f" (every {milliseconds(period)}); {len(self._missed)} such gaps"
            yield Finding(Cause.SYNC_MISSING, "", before.now, text, (before, after))
        elif self._jumps:
            text = f"the SYNC counter jumps {len(self._jumps)} times: frames lost, or two producers"
            yield Finding(Cause.SYNC_MISSING, "", self._jumps[0].now, text, tuple(self._jumps))
        if len(self._jitter) > max(2, _JITTERY_SHARE * self._count):
            worst, sight = max(self._jitter, key=lambda each: each[0])
            text = (
                f"SYNC is up to {milliseconds(worst)} off its period of {milliseconds(period)}, "
                f"{len(self._jitter)} of {self._count} more than {_JITTER:.0%}"
            )
            first = self._jitter[0][1]
            yield Finding(Cause.SYNC_JITTER, "", first.now, text, (sight,))

    def _period(self) -> float:
        return fmean(self._recent) if len(self._recent) >= _FEWEST else 0.0

    def _hear_interval(self, last: Sight, sight: Sight) -> None:
        interval, period = sight.now - last.now, self._period()
        if period and interval > _MISSED * period:
            self._missed.append((last, sight))
            return
        if period and abs(interval - period) > _JITTER * period:
            self._jitter.append((abs(interval - period), sight))
        self._recent.append(interval)

    def _hear_counter(self, sight: Sight) -> None:
        counter = sight.frame.data[0] if len(sight.frame.data) == 1 else None
        before, self._counter = self._counter, counter
        if counter is not None and before is not None and counter not in {before + 1, 1}:
            self._jumps.append(sight)


class ErrorFrames:
    """Keeps what the adapter reports of errors on the bus."""

    def __init__(self) -> None:
        self._sights: list[Sight] = []
        self._count = 0

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        if is_error_frame(sight.frame):
            self._count += 1
            if len(self._sights) < EVIDENCE:
                self._sights.append(sight)

    def findings(self, _end: int) -> Iterator[Finding]:
        """Yield that there were some.

        Yields:
            At most one finding.
        """
        if self._sights:
            first = self._sights[0]
            text = f"{self._count} error frames, the first at {seconds(first.now)}: {first.problem}"
            yield Finding(Cause.ERROR_FRAMES, "", first.now, text, tuple(self._sights))


class Emergencies:
    """Keeps the history of EMCY."""

    def __init__(self) -> None:
        self._errors: dict[tuple[str, int], list[Sight]] = {}
        self._resets: dict[str, Sight] = {}

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        code = sight.emcy_code
        if code is None:
            return
        if is_error_reset(code):
            self._resets[sight.node] = sight
        else:
            self._errors.setdefault((sight.node, code), []).append(sight)

    def findings(self, end: int) -> Iterator[Finding]:  # noqa: ARG002 - as every watch
        """Yield the errors that nodes have reported.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """
        for (node, code), sights in self._errors.items():
            text = (
                f"{node} reports 0x{code:04X}, {emergency_text(code)}, at {seconds(sights[0].now)}"
            )
            text += f", {len(sights)} times" if len(sights) > 1 else ""
            reset = self._resets.get(node)
            if reset is not None and reset.now > sights[-1].now:
                text += f"; gone at {seconds(reset.now)}"
            yield Finding(Cause.EMCY, node, sights[0].now, text, tuple(sights))


class Load:
    """Watches how busy the bus is.

    Args:
        bitrate: of the bus [bit/s].
    """

    def __init__(self, bitrate: int) -> None:
        self._bitrate = bitrate
        self._bits: dict[int, float] = {}
        self.total = 0.0

    def count(self, now: int, length: int, *, is_extended: bool) -> None:
        """Take a frame."""
        bits = frame_bits(length, is_extended=is_extended)
        window = now // _WINDOW
        self._bits[window] = self._bits.get(window, 0.0) + bits
        self.total += bits

    def findings(self, end: int) -> Iterator[Finding]:
        """Yield the times of high load, as one.

        Args:
            end: of the log [ns].

        Yields:
            The finding.
        """
        most = self._bitrate * _WINDOW * 1e-9
        high = {
            window: bits / most
            for window, bits in self._bits.items()
            if bits > _HIGH_LOAD * most and (window + 1) * _WINDOW <= end
        }
        if high:
            first, worst = min(high), max(high.values())
            text = (
                f"load up to {worst:.0%} in 100 ms, from {seconds(first * _WINDOW)} on: "
                "PDOs of low priority wait for long"
            )
            yield Finding(Cause.BUS_LOAD, "", first * _WINDOW, text)
