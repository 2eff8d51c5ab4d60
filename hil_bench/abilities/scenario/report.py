"""The report of scenarios: its content, its exhibits, its page."""

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import PurePath

from hil_bench.abilities.common.page import render_page
from hil_bench.abilities.scenario.examination import Examination
from hil_bench.abilities.scenario.judgement import (
    WORST_FIRST,
    Evidence,
    Judgement,
    RequirementOutcome,
    show_seen,
    show_share,
)
from hil_bench.abilities.scenario.picture import Scene, draw_scene
from hil_bench.abilities.scenario.recorded import Finding
from hil_bench.bench.virtual_bench import FrameReader
from hil_bench.outside.recording.channels import LoggedFrame

# The content of a report: a chapter a run, and the tables over all of them.

NOT_JUDGED = "not judged"
"""Of a requirement that a scenario is about without expecting anything under its id."""

_WORST_FIRST = (*WORST_FIRST[:-1], NOT_JUDGED, WORST_FIRST[-1])


@dataclass(frozen=True, slots=True)
class FrameLine:
    """A frame in words.

    Attributes:
        time: [s].
        bus: its number.
        raw: identifier and data as candump has them.
        direction: seen from the bench; empty where it is not known.
        name: whose frame and which.
        meaning: what it says; empty for nothing.
    """

    time: float
    bus: int
    raw: str
    direction: str
    name: str
    meaning: str


@dataclass(frozen=True, slots=True)
class FrameTable:
    """Some frames of a run.

    Attributes:
        title: which.
        lines: oldest first.
    """

    title: str
    lines: tuple[FrameLine, ...]


@dataclass(frozen=True, slots=True)
class Exhibit:
    """The evidence for a requirement's outcome.

    Attributes:
        violated: begin and end of each time in which it is violated [s].
        frames: those around the instant that decides.
        picture: an SVG file; empty for none.
    """

    violated: tuple[tuple[float, float], ...] = ()
    frames: tuple[FrameTable, ...] = ()
    picture: bytes = b""


@dataclass(frozen=True, slots=True)
class Proof:
    """A requirement in one run.

    Attributes:
        id: of the requirement.
        that: its text.
        judgement: what the run says of it.
        reason: the same in a line.
        exhibit: None for a requirement that is passed.
    """

    id: str
    that: str
    judgement: Judgement
    reason: str
    exhibit: Exhibit | None = None


@dataclass(frozen=True, slots=True)
class Chapter:
    """A run: a scenario that was played, or a recording that was judged.

    Attributes:
        source: its file.
        title: in words.
        requirement_ids: the requirements that it is about.
        facts: seed, bench, parameters and the like: name and text.
        configuration: settings of the bench that are not its defaults, a line each.
        command: repeats it.
        problems: what went wrong beside the requirements.
        proofs: its requirements.
        outcome: what its problems make of the whole.
    """

    source: str
    title: str
    requirement_ids: tuple[str, ...]
    facts: tuple[tuple[str, str], ...]
    configuration: tuple[str, ...]
    command: str
    problems: tuple[str, ...]
    proofs: tuple[Proof, ...]
    outcome: RequirementOutcome = RequirementOutcome.FAILED

    @property
    def name(self) -> str:
        """The name of its file, without folder and suffixes."""
        name = PurePath(self.source).name
        return name.partition(".")[0] or name


@dataclass(frozen=True, slots=True)
class Row:
    """A requirement over all runs.

    Attributes:
        id: of the requirement.
        texts: what is expected under this id, in the order of the runs, each once.
        outcome: the worst of all runs.
        margin: the lowest of all runs, as a share of the tolerance; None where none has a size.
        proven: numbers of the chapters in which it is passed, from 1.
        cells: the outcome in each chapter; empty where a chapter does not have it.
    """

    id: str
    texts: tuple[str, ...]
    outcome: str
    margin: float | None
    proven: tuple[int, ...]
    cells: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Report:
    """A whole report.

    Attributes:
        title: in words.
        facts: versions and the like: name and text.
        chapters: one a run.
    """

    title: str
    facts: tuple[tuple[str, str], ...]
    chapters: tuple[Chapter, ...]

    @property
    def rows(self) -> tuple[Row, ...]:
        """A row a requirement, in the order in which the runs name them."""
        names = [name for chapter in self.chapters for name in _names(chapter)]
        return tuple(_row(name, self.chapters) for name in dict.fromkeys(names))

    @property
    def outcome(self) -> str:
        """The worst outcome of the requirements, and of runs that had a problem."""
        ends = [chapter.outcome for chapter in self.chapters if chapter.problems]
        return _worst([*ends, *(row.outcome for row in self.rows)])


def _names(chapter: Chapter) -> Iterator[str]:
    yield from chapter.requirement_ids
    yield from (proof.id for proof in chapter.proofs)


def _row(name: str, chapters: Sequence[Chapter]) -> Row:
    cells = tuple(_cell(name, chapter) for chapter in chapters)
    proofs = [proof for chapter in chapters for proof in chapter.proofs if proof.id == name]
    margins = [p.judgement.margin for p in proofs if p.judgement.margin is not None]
    return Row(
        name,
        tuple(dict.fromkeys(proof.that for proof in proofs)),
        _worst([cell for cell in cells if cell]),
        min(margins, default=None),
        tuple(number for number, cell in enumerate(cells, 1) if cell == RequirementOutcome.PASSED),
        cells,
    )


def _cell(name: str, chapter: Chapter) -> str:
    found = [proof.judgement.outcome.value for proof in chapter.proofs if proof.id == name]
    if not found and name in chapter.requirement_ids:
        return NOT_JUDGED
    return _worst(found) if found else ""


def _worst(outcomes: Sequence[str]) -> str:
    return min(outcomes, key=_WORST_FIRST.index, default=NOT_JUDGED)


# The evidence for a requirement's outcome: times, frames and a picture.

_BEFORE, _AFTER = 2_000_000_000, 100_000_000  # reach of the frames around an instant [ns]
_KNOWN = 2 * _BEFORE  # reach of those that say what is no news at its beginning [ns]
_MOST_BEFORE, _MOST_AFTER = 16, 4  # frames
_DECIDING = "the deciding instant"
_UNDECIDED = {RequirementOutcome.INCONCLUSIVE, RequirementOutcome.NOT_EXERCISED}


def moments_of(judgement: Judgement) -> dict[str, float]:
    """Return the instants around which to show frames, in the order of time [s]."""
    if judgement.outcome in _UNDECIDED or judgement.deciding is None:
        return {}
    moments = {_DECIDING: judgement.deciding.time}
    if judgement.first is not None and judgement.first != judgement.deciding.time:
        moments["the first violation"] = judgement.first
    return dict(sorted(moments.items(), key=lambda each: each[1]))


def is_near(now: int, moments: Iterable[float]) -> bool:
    """Return True if a frame at a time [ns] says something on one of some instants [s]."""
    return any(-_KNOWN <= now - round(moment * 1e9) <= _AFTER for moment in moments)


def make_exhibit(finding: Finding, evidence: Evidence) -> Exhibit:
    """Make the evidence for a requirement's outcome."""
    requirement, judgement = finding
    tick = evidence.tick_ns * 1e-9
    examination = Examination(
        requirement.condition, evidence.columns, evidence.ticks, evidence.tick_ns, evidence.planned
    )
    spans = examination.violated_spans() if evidence.ticks else []
    violated = tuple((first * tick, (last + 1) * tick) for first, last in spans)
    moments = moments_of(judgement)
    instant = moments.get(_DECIDING)
    scene = Scene(
        requirement.condition,
        examination.find_cause().node if instant is not None else None,
        instant,
        violated,
        evidence,
    )
    frames: tuple[FrameTable, ...] = ()
    if evidence.reader is not None:
        frames = tuple(
            table
            for what, moment in moments.items()
            for table in _tables(evidence.frames, evidence.reader, what, moment)
        )
    return Exhibit(violated, frames, draw_scene(scene))


def _tables(
    frames: Sequence[LoggedFrame], reader: FrameReader, what: str, moment: float
) -> Iterator[FrameTable]:
    now = round(moment * 1e9)
    known = bisect_right(frames, now - _KNOWN, key=_time)
    begin = bisect_right(frames, now - _BEFORE, key=_time)
    end = bisect_right(frames, now + _AFTER, key=_time)
    around = frames[begin:end]
    news = [each for each in reader.news(frames[known:end]) if each.now > now - _BEFORE]
    place = bisect_right(news, now, key=_time)
    shown = news[max(0, place - _MOST_BEFORE) : place + _MOST_AFTER]
    before = around[: bisect_right(around, now, key=_time)]
    for title, part in (
        (f"Frames around {what}, at {moment:g} s", shown),
        (f"Last cyclic frames before {what}", list(reader.latest(before))),
    ):
        if part:
            yield FrameTable(title, tuple(_line(logged, reader) for logged in part))


def _time(logged: LoggedFrame) -> int:
    return logged.now


def _line(logged: LoggedFrame, reader: FrameReader) -> FrameLine:
    frame = logged.frame
    directions = {True: "to the bench", False: "from the bench", None: ""}
    return FrameLine(
        logged.now * 1e-9,
        frame.bus,
        f"{frame.can_id:03X}#{frame.data.hex().upper()}",
        directions[logged.is_received],
        reader.name(frame),
        reader.meaning(frame),
    )


# The report as one HTML file that opens offline: no script, nothing from elsewhere.


def report_html(report: Report) -> str:
    """Return a report as HTML."""
    content = {"report": report, "show_share": show_share, "show_seen": show_seen}
    return render_page(__package__, "report.html.j2", content, _shown)


def _shown(value: object) -> object:
    return f"{value:.4g}" if isinstance(value, float) else "" if value is None else value
