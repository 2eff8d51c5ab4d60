"""EMCY, error frames and the load of a bus."""

from collections.abc import Iterator

from hil_bench.abilities.eyes.explain.finding import Cause, Evidence, Finding, finding, seconds
from hil_bench.abilities.eyes.sight import Service, Sight
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.words import emergency_text, is_error_reset
from hil_bench.frame import bits_of, frame_bits, is_error_frame

_WINDOW = 100_000_000
_HIGH_LOAD = 0.8
_HALF = 0.5
_BITS = [
    [frame_bits(n, is_extended=is_extended) for n in range(9)] for is_extended in (False, True)
]
"""Bits of a classical frame by kind of identifier and data bytes."""

_MOST = 4096
"""Kinds of errors that are kept."""


class ErrorFrames:
    """Keeps what the adapter reports of errors on the bus."""

    hears = frozenset({Service.OTHER})

    def __init__(self) -> None:
        self._sights = Evidence()

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        if is_error_frame(sight.frame):
            self._sights.append(sight)

    def pause(self, length: int) -> None:
        """Nothing of it depends on the time."""

    def findings(self, _end: int) -> Iterator[Finding]:
        """Yield that there were some.

        Yields:
            At most one finding.
        """
        if self._sights:
            first = self._sights[0]
            text = f"{self._sights.total} error frames, the first at {seconds(first.now)}: "
            yield finding(Cause.ERROR_FRAMES, "", self._sights, text + first.problem)


class Emergencies:
    """Keeps the history of EMCY."""

    hears = frozenset({Service.EMCY})

    def __init__(self) -> None:
        self._errors: dict[tuple[str, int], Evidence] = {}
        self._resets: dict[str, Sight] = {}

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        code = sight.emcy_code
        if code is None:
            return
        if is_error_reset(code):
            self._resets[sight.node] = sight
        elif (sight.node, code) in self._errors or len(self._errors) < _MOST:
            self._errors.setdefault((sight.node, code), Evidence()).append(sight)

    def pause(self, length: int) -> None:
        """Nothing of it depends on the time."""

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
            text += f", {sights.total} times" if sights.total > 1 else ""
            reset, latest = self._resets.get(node), sights.latest
            if reset is not None and latest is not None and reset.now > latest.now:
                text += f"; gone at {seconds(reset.now)}"
            yield finding(Cause.EMCY, node, sights, text)


class Load:
    """Watches how busy the bus is.

    Args:
        bitrate: of the bus [bit/s].
        speedup: how many times faster the data phase of CAN FD is.

    Attributes:
        total: bits of all frames.
    """

    def __init__(self, bitrate: int, speedup: float = 1.0) -> None:
        self._speedup = speedup
        self._most = bitrate * _WINDOW * 1e-9
        self._window = 0
        self._bits = 0.0
        self._high: tuple[int, float] | None = None
        self._shares: dict[Frame, float] = {}
        self._flood = ""
        self.total = 0.0

    def count(self, now: int, frame: Frame) -> None:
        """Take a frame."""
        window = now // _WINDOW
        if window != self._window:
            self._end()
            self._window = window
        if frame.fd:
            bits = bits_of(frame, self._speedup)
        else:
            bits = _BITS[frame.is_extended][len(frame.data)]
        self._bits += bits
        self.total += bits
        if self._bits > _HALF * self._most:  # a window of high load is likely: by whom?
            key = frame._replace(data=b"", bus=0)
            self._shares[key] = self._shares.get(key, 0.0) + bits

    def _end(self) -> None:
        """End a window, and keep the first of high load and the highest load."""
        if self._bits > _HIGH_LOAD * self._most:
            first, worst = self._high or (self._window, 0.0)
            load = self._bits / self._most
            if load > worst:
                frame, share = max(self._shares.items(), key=lambda each: each[1])
                is_most = share > _HALF * sum(self._shares.values())
                self._flood = f"0x{frame.can_id:03X}" if is_most else ""
            self._high = first, max(worst, load)
        self._bits = 0.0
        self._shares.clear()

    def findings(self, end: int) -> Iterator[Finding]:  # noqa: ARG002 - as every watch
        """Yield the times of high load, as one.

        Args:
            end: of the log [ns].

        Yields:
            The finding.
        """
        if self._high is not None:
            first, worst = self._high
            text = (
                f"load up to {worst:.0%} in 100 ms, from {seconds(first * _WINDOW)} on: "
                "frames of low priority wait for long"
            )
            text += f"; most of it is {self._flood}" if self._flood else ""
            yield Finding(Cause.BUS_LOAD, "", first * _WINDOW, text)
