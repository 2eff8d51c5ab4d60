"""The evidence for a requirement's outcome: times, frames and a picture."""

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence

from hil_bench.abilities.scenario.evidence import Evidence
from hil_bench.abilities.scenario.examination import Examination
from hil_bench.abilities.scenario.judgement import Judgement, RequirementOutcome
from hil_bench.abilities.scenario.recorded import Finding
from hil_bench.abilities.scenario.report.content import Exhibit, FrameLine, FrameTable
from hil_bench.abilities.scenario.report.picture import Scene, draw_scene
from hil_bench.outside.recording.logged_frame import LoggedFrame
from hil_bench.session.frame_reader import FrameReader

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
        requirement.condition,
        evidence.columns,
        evidence.ticks,
        evidence.tick_ns,
        evidence.planned,
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
