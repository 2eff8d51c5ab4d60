"""Reads the frames of a bus from the first to the last and says what is wrong."""

from collections.abc import Iterable, Iterator
from typing import Final, NamedTuple

from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.explain.bus import (
    Emergencies,
    ErrorFrames,
    Language,
    Load,
    WrongLengths,
)
from hil_bench.abilities.eyes.explain.finding import Cause, Finding, Watch, more, seconds
from hil_bench.abilities.eyes.explain.hypotheses import fewest
from hil_bench.abilities.eyes.explain.j1939 import LongTransfers, Requests, TroubleCodes
from hil_bench.abilities.eyes.explain.j1939_addresses import Addresses, Names, Restarts
from hil_bench.abilities.eyes.explain.j1939_changes import Changes
from hil_bench.abilities.eyes.explain.j1939_cycles import Cycles
from hil_bench.abilities.eyes.explain.j1939_doubles import Doubles
from hil_bench.abilities.eyes.explain.pdo_settings import PdoSettings, Transfers
from hil_bench.abilities.eyes.explain.presence import Presence
from hil_bench.abilities.eyes.explain.process_data import ProcessData
from hil_bench.abilities.eyes.explain.recordings import Recordings
from hil_bench.abilities.eyes.explain.silence import Heartbeats, Silence
from hil_bench.abilities.eyes.explain.syncs import Syncs
from hil_bench.abilities.eyes.known_ecu import KnownEcu
from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.abilities.eyes.sight import Service, Sight
from hil_bench.abilities.j1939.protocol.signals import NULL
from hil_bench.outside.recording.channels import LoggedFrame

# The time of a log whose clock does not go on evenly, or that holds the frames of two.

_UNSORTED: Final = 5_000_000
"""Time by which frames may be written in another order than they came [ns]."""

_SET_BACK: Final = 50
"""Frames in a row of an earlier time after which the clock was set back for good."""

_LEAP: Final = 60_000_000_000
"""Time without a frame from which on the clock was set, or the recording stopped [ns]."""


class Clock:
    """Gives each frame a time that never goes back, and leaves out those of a second clock."""

    def __init__(self) -> None:
        self._last: int | None = None
        self._offset = 0
        self._strange = 0
        self._left_out = 0
        self._backs: list[int] = []
        self._leaps: list[tuple[int, int]] = []
        self._back_count = 0

    def time_of(self, now: int) -> tuple[int, int] | None:
        """Return the time of a frame and the leap before it [ns]; None for one to leave out."""
        if self._last is None:
            self._last, self._offset = now, -now
            return 0, 0
        step = now - self._last
        if step >= 0:
            self._strange = 0
            self._last = now
            if step <= _LEAP:
                return now + self._offset, 0
            self._leaps.append((now - step + self._offset, step))
            del self._leaps[1:]
            return now + self._offset, step
        if step > -_UNSORTED:
            return self._last + self._offset, 0
        self._strange += 1
        if self._strange < _SET_BACK:
            self._left_out += 1
            return None
        self._strange, self._back_count = 0, self._back_count + 1
        self._backs.append(self._last + self._offset)
        del self._backs[1:]
        self._offset -= step
        self._last = now
        return now + self._offset, 1

    def notes(self) -> Iterator[str]:
        """Yield a line for each oddity."""
        if self._backs:
            again = more(self._back_count, ", and")
            at = f"the clock goes back at {seconds(self._backs[0])}{again}"
            yield f"{at}; what follows is joined on"
        if self._left_out:
            yield f"{self._left_out} frames of an earlier time, as of a second log, are left out"
        for since, step in self._leaps:
            yield f"the clock leaps by {seconds(step)} at {seconds(since)}, or nothing was recorded"


_AT_ONCE = 5_000_000
"""Time within which the PDOs of several nodes stay out together [ns]."""

_OF_SDO = frozenset({Cause.SDO_ABORT, Cause.SDO_NO_ANSWER})


class Explanation(NamedTuple):
    """The explanation of a log.

    Attributes:
        findings: the causes, each with what it leads to.
        frames: how many there were.
        duration: from the first to the last [s].
        nodes: names of those that were heard or spoken to.
        heard: names of those that were heard.
        load: share of the time of the busiest bus that was taken [-].
        notes: what is odd with the log itself.
        languages: those that its frames show to be spoken, "CANopen" and "J1939".
        is_judged: whether one of them is, or the bus has known nodes and no frame is against them.
        unjudged: what of the messages has not been judged, in words; empty for nothing.
    """

    findings: tuple[Finding, ...]
    frames: int
    duration: float
    nodes: tuple[str, ...]
    heard: tuple[str, ...]
    load: float
    notes: tuple[str, ...] = ()
    languages: tuple[str, ...] = ()
    is_judged: bool = True
    unjudged: str = ""


class Explainer:
    """Takes the frames of a bus one after the other, and says at any time what is wrong so far.

    What it keeps does not grow with the number of frames.

    Args:
        known: the nodes that ought to be there.
        bitrate: of the bus [bit/s].
        ecus: the J1939 devices that ought to be there.
        speedup: how many times faster the data phase of CAN FD is.
    """

    def __init__(
        self,
        known: Iterable[KnownNode],
        bitrate: int,
        ecus: Iterable[KnownEcu] = (),
        speedup: float = 1.0,
    ) -> None:
        nodes = list(known)
        self._bitrate = bitrate
        self._decoder = Decoder(nodes, ecus)
        self._speedup, self._silence, self._clock = speedup, Silence(), Clock()
        self._loads: dict[int, Load] = {}
        self._recordings = Recordings()
        self._presence = Presence(self._decoder, nodes)
        self._has_nodes, self._language = bool(nodes), Language()
        self._watches: tuple[Watch, ...] = (
            self._language,
            self._presence,
            Heartbeats(self._decoder),
            Transfers(self._decoder),
            ProcessData(self._decoder),
            PdoSettings(self._decoder),
            ErrorFrames(),
            WrongLengths(),
            Syncs(self._decoder),
            Emergencies(),
            Addresses(),
            Names(),
            Restarts(),
            LongTransfers(),
            Requests(),
            Cycles(),
            Changes(),
            Doubles(),
            TroubleCodes(),
        )
        self._hearers = {
            service: tuple(watch.hear for watch in self._watches if service in watch.hears)
            for service in Service
        }
        self._senders: dict[str, None] = {}
        self._now = 0
        self._frames = 0

    def take(self, logged: LoggedFrame) -> None:
        """Take a frame."""
        self._frames += 1
        timed = self._clock.time_of(logged.now)
        if timed is None:
            return
        now, leap = timed
        frame = logged.frame
        self._now = now
        load = self._loads.get(frame.bus)
        if load is None:
            load = self._loads[frame.bus] = Load(self._bitrate, self._speedup)
        load.count(now, frame)
        self._recordings.take(frame, now)
        if leap:
            self._silence.skip(leap)
            self._presence.leap()
        silent = self._silence.take(frame, now) + leap
        if silent:
            for watch in self._watches:
                watch.pause(silent)
        for sight in self._decoder.take(LoggedFrame(frame, now, logged.is_received)):
            self._hear(sight)

    def _hear(self, sight: Sight) -> None:
        if sight.message is not None and sight.message.source != NULL:
            self._senders[sight.node] = None
        for hear in self._hearers[sight.service]:
            hear(sight)

    def _seen_nodes(self) -> dict[tuple[int, int], str]:
        """Return the names of the nodes that were heard or spoken to, by bus and node-ID."""
        if self._language.is_foreign and not self._has_nodes:
            return {}
        return {key: node.name for key, node in sorted(self._decoder.nodes.items())}

    @property
    def now(self) -> int:
        """Time of the last frame, from the first on [ns]."""
        return self._now

    def finish(self) -> Explanation:
        """End the log: what was under way is interrupted; return what is wrong."""
        for sight in self._decoder.finish():
            self._hear(sight)
        return self.explanation()

    def explanation(self, end: int | None = None) -> Explanation:
        """Return the causes so far.

        Args:
            end: the present [ns]; None for the last frame.
        """
        now = self._now if end is None else max(end, self._now)
        found = [finding for watch in self._watches for finding in watch.findings(now)]
        for bus, load in self._loads.items():
            where = f"channel {bus + 1}: " if len(self._loads) > 1 else ""
            found += [each._replace(text=where + each.text) for each in load.findings(now)]
        found += self._silence.findings(now)
        found += self._recordings.findings()
        scanned = self._presence.scanned
        found = [f for f in found if not (f.cause in _OF_SDO and f.node in scanned)]
        spoken, duration = self._language, now * 1e-9
        busiest = max((load.total for load in self._loads.values()), default=0.0)
        nodes = self._seen_nodes()
        heard = [name for key, name in nodes.items() if self._presence.has_heard(*key)]
        if not self._has_nodes:
            found = [f for f in found if spoken.allows(f.cause)]
        return Explanation(
            _together(fewest(found)),
            self._frames,
            duration,
            (*nodes.values(), *self._senders),
            (*heard, *self._senders),
            busiest / (self._bitrate * duration) if duration else 0.0,
            (*self._clock.notes(), *spoken.notes(self._frames)),
            spoken.names,
            bool(spoken.names or (self._has_nodes and not spoken.is_foreign)),
            spoken.unjudged,
        )


def explain(
    frames: Iterable[LoggedFrame],
    known: Iterable[KnownNode],
    bitrate: int,
    ecus: Iterable[KnownEcu] = (),
    speedup: float = 1.0,
) -> Explanation:
    """Explain a log: find its faults and their causes.

    Args:
        frames: of one bus, in the order of time.
        known: the nodes that ought to be there.
        bitrate: of the bus [bit/s].
        ecus: the J1939 devices that ought to be there.
        speedup: how many times faster the data phase of CAN FD is.
    """
    explainer = Explainer(known, bitrate, ecus, speedup)
    for logged in frames:
        explainer.take(logged)
    return explainer.finish()


def _together(findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """Tell once what the PDOs of several nodes do at one time: whoever they wait for was late."""
    groups: list[list[Finding]] = []
    for finding in findings:
        before = groups[-1][0] if groups else finding
        is_pdo = finding.cause is before.cause is Cause.PDO_MISSING
        if is_pdo and finding is not before and finding.begin - before.begin < _AT_ONCE:
            groups[-1].append(finding)
        else:
            groups.append([finding])
    return tuple(_joined(group) for group in groups)


def _joined(group: list[Finding]) -> Finding:
    first = group[0]
    others = ", ".join(dict.fromkeys(each.node for each in group[1:] if each.node != first.node))
    return first._replace(text=f"{first.text}; at the same time {others}") if others else first


# Causes that come and go on a bus that goes on.

_EVERY: Final = 500_000_000
"""Time between two looks [ns]."""


class Change(NamedTuple):
    """A cause that has come, or is gone.

    Attributes:
        now: when that was noticed [ns].
        finding: the cause.
        is_gone: whether it no longer explains what is on the bus.
    """

    now: int
    finding: Finding
    is_gone: bool


class LiveFindings:
    """Looks now and then what an explainer says, and keeps it.

    Args:
        explainer: takes the frames.

    Attributes:
        findings: the causes of the last look.
    """

    def __init__(self, explainer: Explainer) -> None:
        self._explainer = explainer
        self._look_at = _EVERY
        self.findings: tuple[Finding, ...] = ()

    def look(self, now: int) -> Iterator[Change]:
        """Yield the causes that have come or gone, twice a second.

        Args:
            now: the time, from the first frame on [ns].

        Yields:
            The changes.
        """
        if now < self._look_at:
            return
        self._look_at = now + _EVERY
        before = {_key(each): each for each in self.findings}
        self.findings = self._explainer.explanation(now).findings
        present = {_key(each) for each in self.findings}
        for finding in self.findings:
            if _key(finding) not in before:
                yield Change(now, finding, is_gone=False)
        for key, finding in before.items():
            if key not in present:
                yield Change(now, finding, is_gone=True)


def _key(finding: Finding) -> tuple[str, str]:
    node, _, _ = finding.node.partition(' "')  # without what it says that it is called: that comes
    return finding.cause.name, node
