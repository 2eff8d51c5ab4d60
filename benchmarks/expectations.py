"""The language of expectations: agreement with RTAMT, and what its evaluation costs.

    python benchmarks/expectations.py [--formulas N] [--traces N] [--seconds S] [--repeats N]

1. Agreement: random formulas with random traces, every tick of each. A case is a formula with a
   trace. RTAMT cuts windows at the end of a trace, where ours leave the margin open: its margin
   must lie between our bounds; where these are one number, the difference is counted.
2. Evaluation of 50 requirements over a run of 60 s at 1 kHz, and RTAMT beside it on a shorter run;
   and the run itself, of the built-in bench in virtual time.
3. The monitor while a run goes on, by the length of the blocks that it gets.
4. Scenarios in process: runs a second of one of 5 s with 20 requirements, on one core; the same
   with one requirement, so that the rest is what 20 cost; and what it adds to watch them while the
   run goes on (`--stop-at-failure`).

Times are processor times, medians of repeats in turn. RTAMT needs Python 3.11 or 3.12.
"""

import argparse
import logging
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import occasion
from hil_bench.abilities.scenario.judgement import judge
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.monitor import AT_START, Monitor, StreamBuilder
from hil_bench.abilities.scenario.nodes import Condition, Vocabulary
from hil_bench.abilities.scenario.parse import parse_expectation
from hil_bench.abilities.scenario.resolve import PreparedScenario
from hil_bench.abilities.scenario.run import PlayOptions, play, prepare
from hil_bench.abilities.scenario.values import Block, Floats
from hil_bench.bench.configuration import load_config
from hil_bench.bench.virtual_bench import VirtualBench

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support import expectations as oracle

TICK_NS = 1_000_000
NO_MARGIN = 1e-323
RUN = Vocabulary({"x": "m", "target": "m", "p": "Pa", "q": "Pa", "e": "m"})
FORMS: Mapping[str, tuple[str, str]] = {
    "bound": ("always p < {0} bar", "always (p <= {0}e5)"),
    "two bounds": ("always -{0} bar < p - q < {0} bar", "always ((e <= {0}) and (e >= -{0}))"),
    "settling": (
        "whenever rises(target) then within {0} ms (abs(e) < 0.5 mm for 200 ms)",
        "always ((target >= {0}) implies (eventually[0:{0}] (always[0:200] (abs(e) <= 5e-4))))",
    ),
    "response": (
        "whenever p > 60 bar then within {0} ms q < 60 bar",
        "always ((p >= 60e5) implies (eventually[0:{0}] (q <= 60e5)))",
    ),
    # RTAMT's bounded until had not judged a run of 10 s after five minutes: ours alone.
    "until": ("p < 200 bar until within {0} ms q > 40 bar", ""),
}


def main() -> None:
    """Print the four parts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--formulas", type=int, default=1000)
    parser.add_argument("--traces", type=int, default=100, help="of each formula")
    parser.add_argument("--seconds", type=float, default=10.0, help="of the run that RTAMT judges")
    parser.add_argument("--repeats", type=int, default=5)
    args = occasion.arguments(parser, formulas=3, traces=2, seconds=0.1, repeats=1)
    logging.disable(logging.WARNING)  # RTAMT's, of a variable that it declares by itself
    show_agreement(args.formulas, args.traces)
    show_evaluation(args.repeats, args.seconds)
    show_monitor(args.repeats)
    show_runs(args.repeats)


def show_agreement(formulas: int, traces: int) -> None:
    """Print how many cases agree, and the worst difference."""
    rng = np.random.default_rng(1)
    ticks = exact = outside = 0
    worst = 0.0
    for _ in range(formulas):
        case = oracle.random_case(rng, int(rng.integers(1, 5)), for_rtamt=True)
        node = parse_expectation(case.ours, oracle.VOCABULARY)
        theirs = oracle.rtamt_margins(case.theirs)
        for _ in range(traces):
            columns = oracle.random_trace(rng, case.reach + int(rng.integers(2, 25)))
            expected = np.array(theirs(columns))
            low, high = bounds(node, columns, len(expected))
            same = low == high
            with np.errstate(invalid="ignore"):
                gaps = np.abs(low - expected)[same]
            worst = max(worst, float(np.nanmax(gaps, initial=0.0)))
            outside += int(np.sum((low - NO_MARGIN > expected) | (expected > high + NO_MARGIN)))
            ticks, exact = ticks + len(expected), exact + int(same.sum())
    print(f"agreement: {formulas * traces} cases, {ticks} ticks, {exact} of them decided")
    print(f"  worst difference {worst:g}; outside our bounds: {outside} ticks")


def bounds(node: Condition, columns: Mapping[str, Floats], ticks: int) -> tuple[Floats, Floats]:
    """Return the bounds of the margins of all ticks."""
    stream = StreamBuilder(TICK_NS).build(node, AT_START)
    parts = [stream.push(Block(columns, ticks)), stream.finish()]
    return np.concatenate([p.low for p in parts]), np.concatenate([p.high for p in parts])


def run_columns(ticks: int) -> dict[str, Floats]:
    """Return a run: the target steps every 3 s, the position follows, pressures swing."""
    t = np.arange(ticks) * 1e-3
    target = 0.1 * (np.floor(t / 3.0) % 2)
    e = 0.1 * np.exp(-(t % 3.0) / 0.15)
    p = 50e5 + 15e5 * np.sin(5.0 * t) + 1e4 * np.random.default_rng(2).normal(size=ticks)
    return {"x": target - e, "target": target, "p": p, "q": 100e5 - p, "e": e}


def requirements() -> list[tuple[str, str, str]]:
    """Return name, our text and RTAMT's of 50 requirements."""
    levels = np.linspace(300, 1500, 10).astype(int)
    return [
        (name, ours.format(level), theirs.format(level))
        for level in levels
        for name, (ours, theirs) in FORMS.items()
    ]


def show_evaluation(repeats: int, seconds: float) -> None:
    """Print what judging costs."""
    ticks = 60_000
    columns = run_columns(ticks)
    wanted = [(name, parse_expectation(ours, RUN)) for name, ours, _ in requirements()]
    rounds: dict[str, list[float]] = {name: [0.0] * repeats for name in FORMS}
    for number in range(repeats):
        for name, node in wanted:
            rounds[name][number] += processor_time(
                lambda node=node: judge(node, columns, ticks=ticks, tick_ns=TICK_NS)
            )
    each = {name: statistics.median(times) for name, times in rounds.items()}
    with TemporaryDirectory() as directory:
        controlled = prepared(Path(directory), ["always axis1.P_A < 250 bar"], 60.0)
    for name, work in (
        ("with nobody on its bus", run_bench),
        ("with the example controller", lambda: play(controlled)),
    ):
        run_time = statistics.median(processor_time(work) for _ in range(repeats))
        share = sum(each.values()) / run_time
        print(f"the run of 60 s itself, {name}: {run_time:.2f} s; judging is {share:.1%} of it")
    print(f"50 requirements, 60 s at 1 kHz: {sum(each.values()) * 1e3:.0f} ms", end=" (")
    print(", ".join(f"{name} {t * 1e2:.2f} ms" for name, t in each.items()), end=" each)\n")
    part = {name: column[: int(seconds * 1e3)] for name, column in columns.items()}
    for name, ours, theirs in requirements()[: len(FORMS)]:
        if theirs:
            show_peer(name, ours, theirs, part, repeats)


def run_bench() -> None:
    """Run the built-in bench for 60 s."""
    with VirtualBench(load_config()) as bench:
        bench.run(60.0)


def show_peer(
    name: str, ours: str, theirs: str, columns: Mapping[str, Floats], repeats: int
) -> None:
    """Print what one requirement costs us and RTAMT."""
    node = parse_expectation(ours, RUN)
    evaluate = oracle.rtamt_margins(theirs, tuple(RUN.signals))
    ticks = len(columns["p"])
    data = {key: column.tolist() for key, column in columns.items()}
    mine, other = [], []
    for _ in range(repeats):
        mine.append(processor_time(lambda: judge(node, columns, ticks=ticks, tick_ns=TICK_NS)))
        other.append(processor_time(lambda: evaluate(data)))
    one, two = statistics.median(mine), statistics.median(other)
    print(
        f"  {name}, {ticks / 1e3:g} s: {one * 1e3:.2f} ms, RTAMT {two * 1e3:.0f} ms, "
        f"ratio {two / one:.0f}"
    )


def show_monitor(repeats: int) -> None:
    """Print what a tick costs while a run goes on."""
    ticks = 10_000
    columns = run_columns(ticks)
    nodes = [parse_expectation(ours, RUN) for _, ours, _ in requirements()[:20]]
    for size in (1, 10, 50, 100, 500):
        taken = ticks if size > 1 else 2000
        times = []
        for _ in range(repeats):
            monitors = [Monitor(node, TICK_NS) for node in nodes]
            times.append(processor_time(lambda m=monitors, s=size, t=taken: feed(m, columns, s, t)))
        cost = statistics.median(times) / taken * 1e6
        print(f"20 monitors, blocks of {size}: {cost:.2f} us a tick, {cost / 20:.3f} us each")


def feed(monitors: list[Monitor], columns: Mapping[str, Floats], size: int, ticks: int) -> None:
    """Give a run to monitors in blocks."""
    for start in range(0, ticks, size):
        part = {name: column[start : start + size] for name, column in columns.items()}
        for monitor in monitors:
            monitor.push(part, size)


def show_runs(repeats: int) -> None:
    """Print how many runs of a scenario a core makes in a second."""
    texts = [f"always axis1.P_A < {level} bar" for level in range(241, 261, 4)]
    texts += [f"whenever axis1.P_A > {level} bar then axis1.P_B > 1 bar" for level in range(5)]
    texts += [f"always after 3 s abs(axis1.position) < {level} mm" for level in range(195, 200)]
    texts += [
        f"always after 4 s within 200 ms abs(axis1.speed) < {level} mm/s" for level in range(1, 6)
    ]
    with TemporaryDirectory() as directory:
        many, one = (prepared(Path(directory), part) for part in (texts, texts[:1]))
    cases: dict[str, Callable[[], object]] = {
        "20 requirements": lambda: play(many),
        "20 requirements, watched": lambda: play(many, PlayOptions(stops_at_failure=True)),
        "1 requirement": lambda: play(one),
    }
    play(one)  # what is done once only
    times: dict[str, list[float]] = {name: [] for name in cases}
    for _ in range(repeats):
        for name, case in cases.items():
            times[name].append(processor_time(case))
    print("a scenario of 5 s, position control with a supply that sags:")
    for name, found in times.items():
        cost = statistics.median(found)
        print(f"  {name}: {cost * 1e3:.0f} ms, {1 / cost:.2f} runs a second")


def prepared(directory: Path, texts: Sequence[str], duration: float = 5.0) -> PreparedScenario:
    """Return a scenario with some requirements."""
    path = directory / f"{len(texts)}.scenario.toml"
    expectations = (
        f'[[expect]]\nid = "R{number}"\nthat = "{text}"\n' for number, text in enumerate(texts)
    )
    path.write_text(
        f'title = "T"\nduration_s = {duration}\n'
        '[controller]\nexample = "position_control"\n[[step]]\n'
        'at_s = 0.5\nfault = "drop_supply"\ntarget = "axis1"\npressure_bar = 40.0\nfor_s = 0.5\n'
        + "".join(expectations)
    )
    return prepare(load_scenario(path))


def processor_time(work: Callable[[], object]) -> float:
    """Return the processor time of a call [s]."""
    start = time.process_time()
    work()
    return time.process_time() - start


if __name__ == "__main__":
    main()
