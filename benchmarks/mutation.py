"""Mutation scores: how many small faults in a package do its fast tests notice?

``python benchmarks/mutation.py [AREA ...] [--sample N] [--seed S]`` draws mutants of each area at
random, runs the tests of each mutated line up to the first that fails, and prints a table. A kill
counts where that test passes without the mutant. Results are kept in ``--results``, so a run goes
on where the last one ended; ``--again`` repeats what survived. An area is a package, an ability,
``drivers``, or the path of a folder or module.

Each mutant is a fork of a process that has imported pytest and the libraries. Nothing on disk
changes: the import system hands the mutated module out. Processes that a test starts itself
import the real one.
"""

import argparse
import ast
import contextlib
import functools
import gc
import hashlib
import importlib.machinery
import importlib.util
import itertools
import json
import math
import os
import random
import resource
import select
import signal
import sys
import tempfile
import time
import types
from collections.abc import Iterator, Sequence
from pathlib import Path

import canopen  # noqa: F401 - these are imported once, before each fork
import hypothesis
import numba  # noqa: F401
import pymodbus.pdu  # noqa: F401
import pytest

import occasion
from mutants import Mutant, mutants
from mutation_tests import areas, is_kernel, modules, tests_of_line

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "build" / "mutation.jsonl"
LONGEST = 60  # s of processor time for a mutant, whose tests take 20 s at most without it
MEMORY = 2 << 30  # bytes
WAIT = 300.0  # s until a mutant that does nothing is ended
VERDICTS = ("killed", "time-out", "survived")
Z = 1.96  # of a confidence of 95 %


class MutatedModule(importlib.machinery.SourceFileLoader):
    """Hands out one module with a fault in it; also the finder of that module."""

    def __init__(self, path: Path, tree: ast.Module) -> None:
        drivers = ROOT / "drivers"
        root = drivers if path.is_relative_to(drivers) else ROOT
        name = ".".join(path.relative_to(root).with_suffix("").parts)
        super().__init__(name.removesuffix(".__init__"), str(path))
        self.tree = tree

    def find_spec(self, name: str, *_: object) -> importlib.machinery.ModuleSpec | None:
        """Return the module's spec where it is the one asked for."""
        if name != self.name:
            return None
        return importlib.util.spec_from_file_location(name, self.path, loader=self)

    def get_code(self, fullname: str) -> types.CodeType:  # noqa: ARG002
        """Return the code with the fault."""
        return compile(self.tree, self.path, "exec", dont_inherit=True)


class FirstFailure:
    """Writes down the test, or the file of tests, that failed first."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Look at a test."""
        self.pytest_collectreport(report)

    def pytest_collectreport(self, report: pytest.TestReport | pytest.CollectReport) -> None:
        """Look at a file of tests."""
        if report.failed and not self.file.exists():
            self.file.write_text(report.nodeid.partition("[")[0], encoding="utf-8")


def run_tests(tests: Sequence[str], failure: Path, mutated: MutatedModule | None) -> int:
    """Run tests in this process and return pytest's exit code."""
    options = ["-q", "-x", "--assert=plain", "-p", "no:cacheprovider", "-p", "no:xdist"]
    options += ["-m", "not long and not hardware and not realtime", "--tb=no", "--no-header"]
    options += ["-W", "ignore::pytest.PytestAssertRewriteWarning", "--hypothesis-profile=mutation"]
    hypothesis.settings.register_profile(
        "mutation",
        deadline=None,
        derandomize=True,
        database=None,
        phases=(hypothesis.Phase.explicit, hypothesis.Phase.generate),
        suppress_health_check=list(hypothesis.HealthCheck),
    )
    if mutated:
        sys.meta_path.insert(0, mutated)
    options.append(f"--basetemp={failure.parent}/tests")
    return int(pytest.main([*options, *tests], plugins=[FirstFailure(failure)]))


def in_fork(
    tests: Sequence[str], failure: Path, mutated: MutatedModule | None, *, as_python: bool
) -> tuple[str, float]:
    """Run tests, with a module replaced; return their ending and processor time [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    pid = os.fork()
    if not pid:
        os.setsid()
        resource.setrlimit(resource.RLIMIT_CPU, (LONGEST, LONGEST + 5))
        resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
        if as_python:
            os.environ["NUMBA_DISABLE_JIT"] = "1"
        del sys.modules["__main__"].__file__  # or each process of a test would import this program
        null = os.open(os.devnull, os.O_RDWR)
        for stream in range(3):
            os.dup2(null, stream)
        code = 1
        try:
            code = run_tests(tests, failure, mutated)
        finally:
            os._exit(code)
    handle = os.pidfd_open(pid)
    in_time = bool(select.select([handle], [], [], WAIT)[0])
    os.close(handle)
    if not in_time:
        os.kill(pid, signal.SIGKILL)
    status = os.waitpid(pid, 0)[1]
    with contextlib.suppress(ProcessLookupError):
        os.killpg(pid, signal.SIGKILL)  # helpers that its tests have left behind
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    ended = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
    if ended in {signal.SIGKILL, signal.SIGXCPU}:
        return "time-out", used
    return ("survived" if status == 0 else "killed"), used


def verdict_of(tests: Sequence[str], path: Path, mutant: Mutant) -> tuple[str, float, str]:
    """Return the verdict on a mutant, the processor time [s], and the test that killed it.

    A test that fails without the mutant, too, is left out.
    """
    total, as_python = 0.0, is_kernel(path)
    while tests:
        with tempfile.TemporaryDirectory() as folder:
            failure = Path(folder, "failure")
            mutated = MutatedModule(path, mutant.tree)
            verdict, used = in_fork(tests, failure, mutated, as_python=as_python)
            total += used
            by = failure.read_text(encoding="utf-8") if failure.exists() else ""
        if verdict == "survived":
            break
        suspects = tuple(name for name in tests if by and name.startswith(by)) or tuple(tests)
        if passes(suspects, as_python=as_python):
            return verdict, total, by
        tests = [name for name in tests if name not in suspects]
    return "survived", total, ""


@functools.cache
def passes(tests: Sequence[str], *, as_python: bool) -> bool:
    """Return True if tests pass without a mutant."""
    with tempfile.TemporaryDirectory() as folder:
        ending, _ = in_fork(tests, Path(folder, "failure"), None, as_python=as_python)
    return ending == "survived"


def draw(area: str, count: int, seed: int) -> list[tuple[Path, int]]:
    """Return a random sample of an area's mutants, by module and number; all for a count of 0.

    Of the same seed, a larger sample begins with the smaller one.
    """
    everything = [
        (path, number)
        for path in areas().get(area) or modules(ROOT / area)
        for number, _ in enumerate(mutants(path.read_text(encoding="utf-8")))
    ]
    random.Random(f"{seed} {area}").shuffle(everything)  # noqa: S311 - a sample, no secret
    return everything[: count or None]


def mutant_of(path: Path, number: int) -> Mutant:
    """Return one mutant of a module."""
    return next(itertools.islice(mutants(path.read_text(encoding="utf-8")), number, None))


def interval(part: int, whole: int) -> tuple[float, float]:
    """Return Wilson's interval of a share at 95 %."""
    share, square = part / whole, Z * Z / whole
    middle = (share + square / 2) / (1 + square)
    half = Z / (1 + square) * math.sqrt(share * (1 - share) / whole + square / (4 * whole))
    return middle - half, middle + half


def known_results(file: Path) -> dict[str, dict[str, object]]:
    """Return the results so far by the mutant's key; of a repeated one the last."""
    if not file.exists():
        return {}
    lines = map(json.loads, file.read_text(encoding="utf-8").splitlines())
    return {line["key"]: line for line in lines}


def judge(area: str, options: argparse.Namespace) -> Iterator[dict[str, object]]:
    """Yield the result of each mutant in the sample of an area."""
    known = known_results(options.results)
    for path, number in draw(area, options.sample, options.seed):
        digest = hashlib.sha256(path.read_bytes()).hexdigest()[:12]
        key = f"{area}: {path.relative_to(ROOT)} {digest} {number}"
        result = known.get(key)
        if result is None or (options.again and result["verdict"] == "survived"):
            mutant = mutant_of(path, number)
            tests = options.tests or tests_of_line(path, mutant.line)
            verdict, used, by = verdict_of(tests, path, mutant)
            where = f"{path.relative_to(ROOT)}:{mutant.line}"
            result = {"key": key, "where": where, "what": mutant.what, "verdict": verdict}
            result |= {"seconds": round(used, 2), "by": by}
            with options.results.open("a", encoding="utf-8") as results:
                results.write(json.dumps(result) + "\n")
            print(f"{time.strftime('%X')} {verdict:9} {where}: {mutant.what}", file=sys.stderr)
        yield result


def row(area: str, verdicts: Sequence[object], population: int) -> str:
    """Return an area's line of the table."""
    killed, expired, survived = (verdicts.count(name) for name in VERDICTS)
    dead, drawn = killed + expired, len(verdicts)
    low, high = interval(dead, drawn)
    return (
        f"| {area} | {population} | {drawn} | {killed} | {expired} | {survived} "
        f"| {dead / drawn:.0%} | {low:.0%} to {high:.0%} |"
    )


def main() -> int:
    """Print the table and what survived; return 1 where a score is below the aim."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("areas", nargs="*", metavar="AREA", help=", ".join(areas()))
    parser.add_argument("--sample", type=int, default=120, help="mutants of an area; 0: all (120)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--again", action="store_true", help="repeat what survived")
    parser.add_argument("--tests", nargs="+", help="these in place of those that run the line")
    parser.add_argument("--results", type=Path, default=RESULTS, help="build/mutation.jsonl")
    parser.add_argument("--least", type=float, default=90.0, help="aim of each score in %% (90)")
    module, test = "hil_bench/canopen_device/sync.py", "tests/unit/canopen_device/test_sync.py"
    brief = {"areas": [module], "tests": [test], "sample": 2, "results": Path(os.devnull)}
    options = occasion.arguments(parser, **brief, least=0.0)
    os.chdir(ROOT)
    gc.freeze()  # what is imported stays, in each fork
    for area in options.areas:
        if area not in areas() and not Path(area).exists():
            parser.error(f"no such area: {area}; there are {', '.join(areas())}, and paths")
    options.results.parent.mkdir(parents=True, exist_ok=True)
    rows, survivors, is_enough = [], [], True
    for area in options.areas or areas():
        results = list(judge(area, options))
        verdicts = [result["verdict"] for result in results]
        rows.append(row(area, verdicts, len(draw(area, 0, 0))))
        lost = [f"{r['where']}: `{r['what']}`" for r in results if r["verdict"] == "survived"]
        is_enough &= 100 * len(lost) <= (100 - options.least) * len(results)
        survivors += lost
    print("| area | mutants | drawn | killed | time-out | survived | score | 95 % interval |")
    print("|---|---|---|---|---|---|---|---|", *rows, "", *survivors, sep="\n")
    return 0 if is_enough else 1


if __name__ == "__main__":
    sys.exit(main())
