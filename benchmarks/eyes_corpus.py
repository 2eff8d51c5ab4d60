"""Judges `explain` by the logs of `tests/corpus`; a part of `eyes.py`."""

import sys
import time
import tracemalloc
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import can

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from corpus.faults import broken_logs
from corpus.logs import sound_logs
from corpus.sound_j1939 import variants

from hil_bench.abilities.eyes.explain.explain import Explainer, Explanation, explain
from hil_bench.abilities.eyes.explain.finding import Finding
from hil_bench.outside.recording.channels import LoggedFrame


class Judgement(NamedTuple):
    """The verdicts on one half of the corpus.

    Attributes:
        sound: sound logs and their sound variants, and those with a finding.
        broken: broken logs, and those whose first finding is the cause, by cause.
        buried: broken logs whose cause stands below another finding, or is told as consequence.
        missed: names of the others.
    """

    sound: tuple[int, list[str]]
    broken: tuple[Counter[str], Counter[str]]
    buried: list[str]
    missed: list[str]


def judge(*, kept_apart: bool, most: int | None = None, series: str = "") -> Judgement:
    """Explain all logs of one half.

    Args:
        kept_apart: which half.
        most: sound logs at most.
        series: which logs.
    """
    accused, total, right, buried, missed = [], Counter[str](), Counter[str](), [], []
    logs = [*sound_logs(kept_apart=kept_apart, series=series)][:most]
    count = 0
    for log in logs:
        for sound in (log, *(variants(log) if series == "j1939" else ())):
            count += 1
            if explain(sound.frames, sound.known(), sound.bitrate).findings:
                accused.append(sound.name)
        for broken in broken_logs(log):
            found = explain(broken.frames, log.known(), log.bitrate)
            total[broken.cause.name] += 1
            if found.findings and broken.is_told_by(found.findings[0]):
                right[broken.cause.name] += 1
            elif any(broken.is_told_by(each) for each in every(found)):
                buried.append(broken.name)
            else:
                missed.append(broken.name)
    return Judgement((count, accused), (total, right), buried, missed)


def every(found: Explanation) -> Iterator[Finding]:
    """Yield all findings, and what they lead to."""
    for each in found.findings:
        yield each
        yield from each.consequences


def print_judgement(found: Judgement, what: str) -> None:
    """Print the figures of one half."""
    logs, accused = found.sound
    total, right = found.broken
    count, good = total.total(), right.total()
    print(f"{what}: {logs} sound logs, {len(accused)} with a finding: {', '.join(accused) or '-'}")
    share = good / count if count else 0.0
    print(f"  {count} broken logs, first finding is the cause in {good}, {share:.1%}")
    print(f"  cause below another finding or its consequence: {len(found.buried)}")
    print(f"  cause not among the findings: {len(found.missed)}")
    for cause in sorted(total):
        print(f"    {cause.lower():18} {right[cause]:3} of {total[cause]:3}")
    for name in (*found.buried, *found.missed):
        print(f"    not first: {name}")


def memory_growth(frames: list[LoggedFrame], log: Path, rounds: int) -> tuple[float, float, float]:
    """Return the peak memory [MB] of explaining frames once and `rounds` times, and of the reader.

    Args:
        frames: of one run; each round goes on where the last has ended.
        log: the same frames as a candump log, for python-can's reader.
        rounds: how often they are taken.
    """
    peaks = []
    for number in (1, rounds):
        tracemalloc.start()
        explainer, offset = Explainer([], 1_000_000), 0
        for _ in range(number):
            for logged in frames:
                explainer.take(logged._replace(now=logged.now + offset))
            offset += frames[-1].now + 1_000_000
        explainer.finish()
        peaks.append(tracemalloc.get_traced_memory()[1] / 1e6)
        tracemalloc.stop()
    tracemalloc.start()
    with can.LogReader(log) as reader:
        for _ in reader:
            pass
    peak = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    return peaks[0], peaks[1], peak


def reader_rate(log: Path) -> float:
    """Return the frames a second of processor time that python-can's reader alone takes."""
    begin, count = time.process_time(), 0
    with can.LogReader(log) as reader:
        for _ in reader:
            count += 1
    return count / (time.process_time() - begin)
