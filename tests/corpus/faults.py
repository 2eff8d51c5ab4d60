"""Faults that are put into sound logs, one at a time, with the cause as label.

A fault is a function from a scene to the broken frames; None where the log has nothing that the
fault could befall. What it does stands in its first line; the label is what it does, and never what
`explain` says. The same log gives the same broken logs, bit for bit.
"""

import itertools
import random
import struct
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from typing import NamedTuple, TypeVar

from corpus.logs import SoundLog, is_kept_apart
from hil_bench.abilities.eyes.explain.finding import Cause, Finding
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import LoggedFrame

MS = 1_000_000
T = TypeVar("T")
Frames = list[LoggedFrame]
Found = tuple[Frames, str] | None
"""The broken frames, and the node whose fault it is; empty for the bus."""
Maker = Callable[["Scene"], Found]

PER_LOG = 8
PER_LOG_OF_J1939 = 16
"""Faults of one log at most, drawn by its name; of J1939 beside the others."""


class BrokenLog(NamedTuple):
    """A log with one fault.

    Attributes:
        name: of the sound log and of the fault.
        frames: in the order of time.
        sound: the log that it comes from.
        cause: the true one.
        node: that has it, several where either may be named, as in ``3|11``; empty for the bus.
    """

    name: str
    frames: tuple[LoggedFrame, ...]
    sound: SoundLog
    cause: Cause
    node: str

    def is_told_by(self, finding: Finding) -> bool:
        """Return True if a finding is the fault that was put in, of the node that has it."""
        words = f"{finding.node} "
        is_node = not self.node or any(
            words.startswith(f"{node} ") or words == f"address {node} "
            for node in self.node.split("|")
        )
        return finding.cause is self.cause and is_node


class Fault(NamedTuple):
    """A registered fault: what it does to a scene, and its label."""

    name: str
    make: Maker
    cause: Cause


FAULTS: dict[str, Fault] = {}
FAULTS_OF_J1939: dict[str, Fault] = {}
"""Those that the logs of the series "j1939" get beside the others."""


def fault(cause: Cause) -> Callable[[Maker], Maker]:
    """Register a function as a fault of a cause."""

    def register(make: Maker) -> Maker:
        FAULTS[make.__name__] = Fault(make.__name__, make, cause)
        return make

    return register


def fault_of_j1939(
    cause: Cause,
) -> Callable[[Callable[["Scene"], Found]], Callable[["Scene"], Found]]:
    """Register a function as a fault of a cause, for the logs of the series "j1939"."""

    def register(make: Callable[["Scene"], Found]) -> Callable[["Scene"], Found]:
        FAULTS_OF_J1939[make.__name__] = Fault(make.__name__, make, cause)
        return make

    return register


class Download(NamedTuple):
    """An expedited SDO download, and the place of its two frames."""

    place: int
    answer: int
    index: int
    subindex: int
    value: int


class Nowhere(Exception):  # noqa: N818 - an answer, not an error
    """The log has nothing that the fault could befall."""


class Scene:
    """A sound log, and who does what in it.

    Args:
        log: the log.
        random: draws times and nodes; seeded by the names of log and fault.
    """

    def __init__(self, log: SoundLog, random: random.Random) -> None:
        self.log = log
        self.random = random
        self.frames = list(log.frames)
        self.end = self.frames[-1].now
        self.is_apart = is_kept_apart(log.name)

    def choose(self, among: Sequence[T]) -> T:
        """Draw one of several.

        Raises:
            Nowhere: there is none.
        """
        if not among:
            raise Nowhere
        return self.random.choice(among)

    def share(self, low: float, high: float) -> float:
        """Draw a parameter: below 60 % of its range for one half of the logs, above for the other.

        So the faults of the half that is kept apart are not those that the rules were written with.
        """
        middle = low + 0.6 * (high - low)
        return self.random.uniform(*((middle, high) if self.is_apart else (low, middle)))

    def times(self, can_id: int, after: int = 0) -> list[int]:
        """Return when frames of an identifier came [ns]."""
        return [
            each.now
            for each in self.frames
            if each.frame.can_id == can_id
            and not each.frame.is_extended
            and not each.frame.is_remote
            and each.now >= after
        ]

    def beating(self) -> list[int]:
        """Return the nodes with a heartbeat of at least eight beats in OPERATIONAL."""
        heard = {each.frame.can_id - 0x700 for each in self.frames}
        return [n for n in range(1, 128) if n in heard and len(self.beats(n)) >= 8]

    def beats(self, node: int) -> list[int]:
        """Return the times of a node's heartbeats in OPERATIONAL, since the last that was not."""
        found: list[int] = []
        for each in self.frames:
            if is_from(each, 0x700 + node) and len(each.frame.data) == 1:
                found = [*found, each.now] if each.frame.data == b"\x05" else []
        return found

    def slaves(self) -> list[int]:
        """Return the nodes that beat, and were asked or commanded by somebody."""
        asked = {
            each.frame.can_id - 0x600 for each in self.frames if 0x600 < each.frame.can_id < 0x680
        }
        return [node for node in self.beating() if node in asked]

    def tpdos(self, node: int) -> list[int]:
        """Return the identifiers of a node's TPDOs that came at least twelve times."""
        ids = (0x180 + node, 0x280 + node, 0x380 + node, 0x480 + node)
        return [can_id for can_id in ids if len(self.times(can_id)) >= 12]

    def period(self, can_id: int) -> int:
        """Return the median interval of an identifier [ns]; 0 for too few frames."""
        times = self.times(can_id)
        gaps = sorted(b - a for a, b in itertools.pairwise(times))
        return gaps[len(gaps) // 2] if len(gaps) >= 8 else 0

    def downloads(self, node: int) -> list[Download]:
        """Return the expedited downloads to a node that were acknowledged."""
        found = []
        for place, each in enumerate(self.frames):
            data = each.frame.data
            if is_from(each, 0x600 + node) and len(data) == 8 and data[0] >> 5 == 1 and data[0] & 2:
                answer = next(
                    (
                        k
                        for k in range(place + 1, min(place + 400, len(self.frames)))
                        if is_from(self.frames[k], 0x580 + node)
                    ),
                    None,
                )
                if answer is not None and self.frames[answer].frame.data[0] == 0x60:
                    index, sub, value = struct.unpack("<HBI", data[1:])
                    found.append(Download(place, answer, index, sub, value))
        return found

    def download(self, node: int, index: int, subindex: int) -> Download | None:
        """Return the last download of an object to a node."""
        found = [d for d in self.downloads(node) if (d.index, d.subindex) == (index, subindex)]
        return found[-1] if found else None

    def somewhen(self, begin: float = 0.4, end: float = 0.6) -> int:
        """Return a time between two shares of the part in which nodes are OPERATIONAL [ns]."""
        start = min((self.beats(node)[0] for node in self.beating()), default=0)
        share = begin + (end - begin) * self.random.random()
        return int(start + (self.end - start) * share)

    def without(self, is_gone: Callable[[LoggedFrame], bool]) -> Frames:
        """Return the frames but some; the log keeps its end."""
        return [each for each in self.frames if not is_gone(each)]


def is_from(logged: LoggedFrame, can_id: int) -> bool:
    """Return True for a data frame of an 11-bit identifier."""
    frame = logged.frame
    return frame.can_id == can_id and not frame.is_extended and not frame.is_remote


def sender(logged: LoggedFrame) -> int:
    """Return the node that sends a frame, by the predefined connection set; 0 for a master."""
    frame = logged.frame
    function, node = frame.can_id & 0x780, frame.can_id & 0x7F
    sent = {0x080, 0x180, 0x280, 0x380, 0x480, 0x580, 0x700}
    return node if function in sent and not frame.is_extended and not frame.is_remote else 0


def changed(
    logged: LoggedFrame, data: bytes | None = None, can_id: int | None = None
) -> LoggedFrame:
    """Return a frame with other data or another identifier."""
    frame = logged.frame
    if data is not None:
        frame = frame._replace(data=data)
    if can_id is not None:
        frame = frame._replace(can_id=can_id)
    return logged._replace(frame=frame)


def merged(frames: Frames, added: list[tuple[int, Frame]]) -> Frames:
    """Return the frames with others at their times [ns]."""
    both = [*frames, *(LoggedFrame(frame, now, None) for now, frame in added)]
    return sorted(both, key=lambda each: each.now)


def faults() -> dict[str, Fault]:
    """Return the faults of every log by their names."""
    for module in ("faults_nodes", "faults_messages", "faults_j1939", "faults_masters"):
        import_module(f"corpus.{module}")
    return FAULTS


def faults_of_j1939() -> dict[str, Fault]:
    """Return those of the series "j1939" alone."""
    for module in ("devices", "messages", "bus", "transfers", "further"):
        import_module(f"corpus.faults_j1939_{module}")
    return FAULTS_OF_J1939


def tried(make: Callable[["Scene"], T | None], log: SoundLog, name: str) -> T | None:
    """Return the result of a function on a log; None where that has nothing for it."""
    try:
        return make(Scene(log, random.Random(f"{log.name} {name}")))  # noqa: S311 - of tests
    except Nowhere:
        return None


def broken_log(log: SoundLog, name: str) -> BrokenLog | None:
    """Return the log with one fault; None where it has nothing that the fault could befall."""
    each = {**faults(), **faults_of_j1939()}[name]
    found = tried(each.make, log, name)
    if found is None:
        return None
    frames, node = found
    return BrokenLog(f"{log.name}:{name}", tuple(frames), log, each.cause, node)


def broken_logs(
    log: SoundLog, most: int = PER_LOG, most_of_j1939: int = PER_LOG_OF_J1939
) -> Iterator[BrokenLog]:
    """Yield the broken logs of a sound one.

    Args:
        log: the sound one.
        most: how many at most.
        most_of_j1939: how many of the series "j1939" beside them.
    """
    yield from _drawn(log, faults(), most)
    if log.series == "j1939":
        yield from _drawn(log, faults_of_j1939(), most_of_j1939)


def _drawn(log: SoundLog, among: dict[str, Fault], most: int) -> Iterator[BrokenLog]:
    order = sorted(among)
    random.Random(log.name).shuffle(order)  # noqa: S311 - a draw of tests
    for name in order:
        if most == 0:
            return
        found = broken_log(log, name)
        if found is not None:
            most -= 1
            yield found
