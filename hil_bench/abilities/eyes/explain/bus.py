"""The language of a bus, its EMCY, error frames and load."""

from collections import Counter
from collections.abc import Iterator

from hil_bench.abilities.eyes.explain.finding import Cause, Evidence, Finding, finding, seconds
from hil_bench.abilities.eyes.j1939 import group_name
from hil_bench.abilities.eyes.sight import Service, Sight
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.words import NO_MEANING, emergency_text, is_error_reset
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


_SEEN_FOR_ONE = 20
"""Frames that CANopen does not have, for each that only CANopen has, on a bus that speaks it."""

_SDO_BYTES = 8

_LEAST_INDEX = 0x1000
"""Of an object that can be read or written (CiA 301, table 39)."""


_CANOPEN = "CiA"
"""How the clauses of causes begin that only CANopen has."""

_UNKNOWN = ("command", "state")
"""How the words of an NMT, a heartbeat or an LSS message begin that CiA 301 and 305 lack."""


class Language:
    """Counts the frames that show whether a bus speaks CANopen, and whether J1939.

    Only CANopen has an NMT command, a heartbeat, node guarding, an empty SYNC, an LSS command, an
    SDO request that is answered. It has no such message of another length or content.
    """

    hears = frozenset(Service) - {Service.PDO, Service.OTHER, Service.TIME}

    def __init__(self) -> None:
        self.for_canopen = 0
        self.against = Evidence()
        self.is_j1939 = False
        self._are_segments = True  # what is against it may be the middle of SDO transfers
        self._messages = 0
        self._unread = Counter[int]()  # messages whose values nobody reads, by parameter group

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        if sight.service is Service.J1939:
            self.is_j1939 = True
            if sight.message is not None:
                self._messages += 1
                if not sight.readings:
                    self._unread[sight.message.group] += 1
        elif _is_against(sight):
            self.against.append(sight)
            is_of_none = sight.service is Service.SDO and sight.transfer is None
            self._are_segments &= is_of_none and len(sight.frame.data) == _SDO_BYTES
        else:
            self.for_canopen += _is_for(sight)

    @property
    def unjudged(self) -> str:
        """The part of the messages that has not been judged, in words; empty for nothing."""
        if not self.is_j1939:
            return ""
        found = "what the messages of J1939 say, but for trouble codes"
        unknown = {group: n for group, n in self._unread.items() if not group_name(group)}
        if unknown:
            share = f"{sum(unknown.values())} of {self._messages}"
            found += f"; {share} have a parameter group that is not known here, "
            found += f"the first {next(iter(unknown))}"
        return found

    def listen(self, sights: list[Sight]) -> list[Sight]:
        """Take sights, and return them."""
        for sight in sights:
            if sight.service in self.hears:
                self.hear(sight)
        return sights

    def pause(self, length: int) -> None:
        """Nothing of it depends on the time."""

    def findings(self, end: int) -> Iterator[Finding]:  # noqa: ARG002 - as every watch
        """Yield nothing: it says who else may."""
        return iter(())

    @property
    def names(self) -> tuple[str, ...]:
        """The languages that the frames show to be spoken."""
        is_spoken = {"CANopen": self.is_canopen, "J1939": self.is_j1939}
        return tuple(name for name, is_one in is_spoken.items() if is_one)

    @property
    def is_canopen(self) -> bool:
        """The frames show that CANopen is spoken."""
        return 0 < self.for_canopen * _SEEN_FOR_ONE >= self.against.total

    @property
    def is_foreign(self) -> bool:
        """The frames show that it is not."""
        return not self.is_canopen and self.against.total > 0

    def allows(self, cause: Cause) -> bool:
        """Return True if what is spoken can have a cause; any eight bytes can be an EMCY."""
        if self.is_foreign:
            return not cause.clause.startswith(_CANOPEN)
        return self.is_canopen or cause is not Cause.EMCY

    def notes(self, frames: int) -> Iterator[str]:
        """Yield a line where CANopen is not what they speak.

        Args:
            frames: how many there were.

        Yields:
            At most one line.
        """
        if self.is_foreign:
            first = self.against[0]
            what = f"{first.frame.can_id:03X} [{first.frame.data.hex(' ').upper()}]"
            or_else = ", or the log begins within SDO transfers" if self._are_segments else ""
            yield (
                f"this is no CANopen{or_else}: {self.against.total} of {frames} frames "
                f"are not as CiA 301 has them, the first at {seconds(first.now)}: {what}"
            )
        elif frames and not self.names:
            yield (
                f"none of {frames} frames shows that CANopen or J1939 is spoken: no NMT command, "
                "no heartbeat, no answered SDO request, no address claim; if it is CANopen, "
                "name its nodes by bench.toml or --eds"
            )


def _is_for(sight: Sight) -> bool:
    match sight.service:
        case Service.SYNC:
            return not sight.frame.data
        case Service.SDO:
            return sight.transfer is not None and sight.transfer.is_answered
        case Service.EMCY:
            return False  # any eight bytes can be one
    return True


def _is_against(sight: Sight) -> bool:
    match sight.service:
        case Service.SDO if sight.transfer is not None:
            return not sight.transfer.is_answered and sight.transfer.index < _LEAST_INDEX
        case Service.SDO:
            return not sight.frame.is_remote  # of no transfer
        case Service.EMCY:
            code = sight.emcy_code
            return bool(sight.problem) or (code is not None and emergency_text(code) == NO_MEANING)
    return bool(sight.problem) or sight.words.startswith(_UNKNOWN)


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


class WrongLengths:
    """Keeps messages to all nodes that are none by their length: of NMT, and SYNC.

    The identifiers of a node's own services may be those of a device that is no CANopen.
    """

    hears = frozenset({Service.NMT, Service.SYNC})

    def __init__(self) -> None:
        self._sights: dict[int, Evidence] = {}

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        if sight.problem and not sight.frame.is_remote:
            self._sights.setdefault(sight.frame.can_id, Evidence()).append(sight)

    def pause(self, length: int) -> None:
        """Nothing of it depends on the time."""

    def findings(self, _end: int) -> Iterator[Finding]:
        """Yield a finding for each identifier that has some.

        Yields:
            The findings.
        """
        for can_id, sights in self._sights.items():
            first = sights[0]
            text = f"{sights.total} with {can_id:03X}, the first at {seconds(first.now)}: "
            yield finding(Cause.WRONG_LENGTH, first.node, sights, text + first.problem)


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
        total: bits of all frames behind the first instant, whose frames were sent before it.
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
            self._window, self._bits = window, 0.0
            self._shares.clear()
        if frame.fd:
            bits = bits_of(frame, self._speedup)
        else:
            bits = _BITS[frame.is_extended][len(frame.data)]
        self._bits += bits
        self.total += bits if now else 0.0
        if self._bits > _HALF * self._most:  # a window of high load is likely: by whom?
            key = frame._replace(data=b"")
            self._shares[key] = self._shares.get(key, 0.0) + bits
        if self._bits > _HIGH_LOAD * self._most:
            self._keep()

    def _keep(self) -> None:
        """Keep the first window of high load and the highest load."""
        first, worst = self._high or (self._window, 0.0)
        load = self._bits / self._most
        if load > worst:
            flood, share = max(self._shares.items(), key=lambda each: each[1])
            is_most = share > _HALF * sum(self._shares.values())
            self._flood = f"0x{flood.can_id:03X}" if is_most else ""
        self._high = first, max(worst, load)

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
