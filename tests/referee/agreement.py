"""The product's verdict on a case, beside the referee's."""

import contextlib
import io
import json
import math
import random
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np

from hil_bench import ConfigError, cli
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.abilities.scenario.judgement import Judgement, judge
from hil_bench.abilities.scenario.load import load_requirements
from hil_bench.abilities.scenario.monitor import Monitor
from hil_bench.abilities.scenario.nodes import Vocabulary
from hil_bench.abilities.scenario.parse import parse_expectation
from hil_bench.abilities.scenario.recorded import judge_with_trace
from hil_bench.abilities.scenario.syntax import ExpectationError
from hil_bench.errors import NothingSeenError
from referee.asking import conditions_in, laid_on_ticks, names_in, refusals
from referee.cases import Case, bits, written
from referee.evaluator import FAILED, INCONCLUSIVE, NOT_EXERCISED, PASSED, Ruling, Run
from referee.language import PLAIN, UNITS, Comparison, Number

SI = {
    "pressure": "Pa",
    "length": "m",
    "speed": "m/s",
    "pressure rate": "Pa/s",
    "force": "N",
    "time": "s",
    "flow": "m³/s",
    "plain": "-",
}
"""The symbol of the SI unit of each kind."""


EXIT_CODES = {PASSED: 0, FAILED: 1, INCONCLUSIVE: 6, NOT_EXERCISED: 6}
ROUNDING = 1e-12
ROUNDED = "by rounding: "
SAME_UNITS = {"-", *(unit for units in UNITS.values() for unit in units)}
WRONG_UNIT = ["makes no sense"]
OPEN_UNIT = ["a number without a unit"]
NO_GRID = ["not evenly spaced", "the time does not go on", "has 1 rows", "has 0 rows"]


def differences_in_memory(case: Case) -> Iterator[str]:
    """Yield what the referee contradicts of `judge` and of a monitor that is given blocks."""
    columns = {
        name: np.array([bits(x, place) for place, x in enumerate(column)])
        for name, column in case.values().items()
    }
    tick_ns = int(case.tick * 10**9)
    expected = refusals(case.tree, case.tick, None)
    try:
        requirement = parse_expectation(case.text, vocabulary_of(case))
        judgement = judge(requirement, columns, ticks=case.ticks, tick_ns=tick_ns)
    except ExpectationError as error:
        if not any(reason in str(error) for reason in expected):
            yield f"refused, the referee does not: {error}"
        return
    if expected:
        yield f"not refused, the referee says: {expected}"
        return
    run = Run(case.values(), case.ticks, case.tick)
    found = [*differences(run, case.tree, judgement, case.tick)]
    found += differences_of_monitor(run, case, Monitor(requirement, tick_ns), columns)
    yield from marked(found, run, is_exact=case.is_exact)


def differences_of_monitor(run: Run, case: Case, monitor: Monitor, columns) -> Iterator[str]:
    """Yield what the referee contradicts of a monitor that is given blocks of some lengths."""
    ruling = run.rule(case.tree)
    start, chance = 0, random.Random(case.number)  # noqa: S311 - a sample, no secret
    while start < case.ticks:
        end = min(start + chance.randrange(1, 10), case.ticks)
        monitor.push({name: c[start:end] for name, c in columns.items()}, end - start)
        low, high = monitor.margin
        if low > upper(ruling.margin.low) or high < lower(ruling.margin.high):
            yield f"monitor: after {end} ticks bounds that are too narrow: {low}, {high}"
        start = end
    monitor.finish()
    for name, ours, theirs in zip(("low", "high"), monitor.margin, ruling.margin, strict=True):
        if not is_margin(ours, theirs):
            yield f"monitor: {name} {ours}, the referee says {theirs}"


def vocabulary_of(case: Case) -> Vocabulary:
    """Return the names that a case knows."""
    parameters = {name: float(number.size) for name, number in case.parameters.items()}
    return Vocabulary({n: SI[kind] for n, kind in case.kinds.items()}, parameters=parameters)


def differences_of_file(case: Case, folder: Path) -> Iterator[str]:
    """Yield what the referee contradicts of a file's requirement, held against another file."""
    requirement, recording = write_case(case, folder)
    laid = laid_on_ticks([time for time, _ in case.rows], case.duration)
    expected = NO_GRID if laid is None else refusals(case.tree, laid[2], case.duration)
    odd = {name for name, (_, size) in case.logged.items() if size is None}
    percents = {name for name, (unit, _) in case.logged.items() if unit == "%"}
    try:
        file = load_requirements(requirement)
        found = judge_with_trace(file, read_recording(recording), "run.csv").findings[0]
    except (ConfigError, NothingSeenError, ExpectationError) as error:
        allowed = [*expected, *(WRONG_UNIT if odd else ()), *(OPEN_UNIT if percents else ())]
        if not any(reason in str(error) for reason in allowed):
            yield f"refused, the referee does not: {error}"
        return
    if expected or is_compared(case.tree, odd):
        yield f"not refused, the referee says: {expected or 'a unit that is not known'}"
        return
    if odd:
        return  # it is compared with itself and 0 only
    run, tick = run_of_file(case, laid)
    judgement, is_planned = found.judgement, case.duration is not None
    wrong = [*differences(run, case.tree, judgement, tick, is_planned=is_planned)]
    is_exact = case.is_exact and all(unit in SAME_UNITS for unit, _ in case.logged.values())
    yield from marked(wrong, run, is_exact=is_exact)


def differences_of_verb(case: Case, folder: Path) -> Iterator[str]:
    """Yield what the referee contradicts of what the verb `judge` prints, and of its exit code."""
    laid = laid_on_ticks([time for time, _ in case.rows], case.duration)
    is_odd = any(size is None or unit == "%" for unit, size in case.logged.values())
    if is_odd or laid is None or refusals(case.tree, laid[2], case.duration):
        return
    files = [str(path) for path in write_case(case, folder)]
    with contextlib.redirect_stdout(io.StringIO()) as written_out:
        code = cli.main(["judge", *files, "--json"])
    if not written_out.getvalue():
        yield f"refused with exit code {code}, the referee does not"
        return
    ((found,),) = json.loads(written_out.getvalue()).values()
    run, _ = run_of_file(case, laid)
    outcome, given = run.rule(case.tree).outcome, found["judgement"]["outcome"]
    wrong = [f"{given}, the referee says {outcome}"] if given != outcome else []
    if code != EXIT_CODES[outcome]:
        wrong.append(f"exit code {code} of {outcome}")
    yield from marked(wrong, run, is_exact=False)


def is_compared(tree, names: set[str]) -> bool:
    """Return whether a signal of some names is compared with a number that has a unit."""
    return any(
        isinstance(part, Comparison)
        and part.kind != PLAIN
        and any(names & names_in(side) for side in part.sides)
        and any(isinstance(side, Number) and side.size for side in part.sides)
        for part in conditions_in(tree)
    )


def marked(found: list[str], run: Run, *, is_exact: bool) -> list[str]:
    """Return differences, marked where two sides of a comparison differ by rounding only."""
    is_rounded = found and not is_exact and run.closest < ROUNDING
    return [f"{ROUNDED}{each}" for each in found] if is_rounded else found


def run_of_file(case: Case, laid: tuple) -> tuple[Run, Fraction]:
    """Return the run that a file shows, and its tick; what lacks a row is unknown there."""
    places, ticks, tick = laid
    rows = dict(zip(places, (row for _, row in case.rows), strict=True))
    values = {
        name: [column[rows[n]] if n in rows else None for n in range(ticks)]
        for name, column in case.values().items()
    }
    seen = max((place + 1 for place in places if place < ticks), default=0)
    return Run(values, ticks, tick, max(seen, 0)), tick


def write_case(case: Case, folder: Path) -> tuple[Path, Path]:
    """Write a case as a file of requirements and a recording in CSV, and return both."""
    lines = [] if case.duration is None else [f"duration_s = {written(case.duration)}"]
    lines += ["[parameters]", *(f"{name} = {each.text}" for name, each in case.parameters.items())]
    lines += ["[[expect]]", 'id = "R-1"', f"that = {json.dumps(case.text, ensure_ascii=False)}"]
    requirement = folder / "requirement.toml"
    requirement.write_text("\n".join(lines) + "\n", encoding="utf-8")
    rows = [["time", *case.columns], ["s", *(unit for unit, _ in case.logged.values())]]
    sizes = {name: size or Fraction(1) for name, (_, size) in case.logged.items()}
    columns = {
        name: [None if x is None else x / sizes[name] for x in column]
        for name, column in case.values().items()
    }
    for time, row in case.rows:
        values = (bits(column[row], row) for column in columns.values())
        rows.append([written(time), *map(repr, values)])
    recording = folder / "run.csv"
    recording.write_text("".join(",".join(row) + "\n" for row in rows), encoding="utf-8")
    return requirement, recording


def differences(
    run: Run, tree, judgement: Judgement, tick: Fraction, *, is_planned: bool = False
) -> Iterator[str]:
    """Yield each point in which a judgement and the referee's ruling differ."""
    ruling = run.rule(tree)
    yield from differences_of_coverage(ruling, judgement.coverage, tick, is_planned)
    if judgement.outcome != ruling.outcome:
        yield f"{judgement.outcome}, the referee says {ruling.outcome}"
        return
    if judgement.triggered != ruling.triggered:
        yield f"triggered {judgement.triggered} times, the referee says {ruling.triggered}"
    if ruling.outcome == INCONCLUSIVE:
        if judgement.margin is not None:
            yield f"margin {judgement.margin} of what is not decided"
        return
    bound = ruling.margin.high if ruling.outcome == FAILED else ruling.margin.low
    size = math.inf if judgement.margin is None else judgement.margin
    if not is_margin(math.copysign(size, bound[1]), bound):
        yield f"margin {size}, the referee says {bound}"
    if judgement.margin is not None:
        at = round(judgement.deciding.time / tick)
        if not any(is_close(abs(judgement.margin), each) for each in run.sizes(tree, at)):
            yield f"at {judgement.deciding.time} s no comparison has the margin {judgement.margin}"
    if ruling.first is not None and not is_close(judgement.first, ruling.first * tick):
        yield f"first violated at {judgement.first} s, the referee says {ruling.first} ticks"
    first, last = ruling.asked
    most = max(last - first - ruling.unseen, 0)
    lasts = min(ruling.violated, most) * tick
    if ruling.first is not None and not is_close(judgement.duration, lasts):
        yield f"violated for {judgement.duration} s, the referee says {ruling.violated} ticks"


def differences_of_coverage(ruling: Ruling, coverage, tick: Fraction, is_planned) -> Iterator[str]:
    """Yield what the referee contradicts of how much of its time was seen."""
    first, last = ruling.asked
    times = {
        "start": first * tick,
        "end": last * tick,
        "seen": max(last - first - ruling.unseen, 0) * tick,
        "unknown": ruling.unseen * tick,
    }
    for name, time in times.items():
        if not is_close(getattr(coverage, name), time):
            yield f"coverage: {name} {getattr(coverage, name)}, the referee says {float(time)}"
    if coverage.is_stated != (is_planned or ruling.is_stated):
        yield f"coverage: is_stated is {coverage.is_stated}"


def is_close(one: float | None, other: float | Fraction) -> bool:
    """Return whether two numbers are the same but for rounding."""
    return one is not None and math.isclose(one, other, rel_tol=1e-9, abs_tol=1e-12)


def is_margin(ours: float, theirs: tuple) -> bool:
    """Return whether a margin is the referee's, sign and all."""
    size, sign = theirs
    return (ours > 0) == (sign > 0) and math.isclose(ours, size, rel_tol=1e-9, abs_tol=1e-9)


def upper(bound: tuple) -> float:
    return float(bound[0]) + 1e-9


def lower(bound: tuple) -> float:
    return float(bound[0]) - 1e-9
