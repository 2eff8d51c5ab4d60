"""Benchmark of the search on twenty seeded defects, against random and Sobol points.

    python benchmarks/defects.py --language py --runs 40
    python benchmarks/defects.py --language c --runs 40
    python benchmarks/defects.py --only wind_up no_limit --runs 200 --seed 3

Each defect is a change of one place, in benchmarks/defects/defects.toml. A method ends at the first
run that fails a requirement or does not come to its end. `--sound N` plays the controller as it is
at N random points instead: each failure there is a false alarm. So is a shrunk failure that the
controller as it is does not pass: `--shrunk` counts these.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
import tomllib
import types
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from resource import RUSAGE_CHILDREN, RUSAGE_SELF, getrusage

import hil_drivers
import occasion
from hil_bench.abilities.campaign.falsify import SearchPlan, falsify
from hil_bench.abilities.campaign.plan import own_case, space_of
from hil_bench.abilities.campaign.search import ALL_METHODS, Budget, Method, Searcher
from hil_bench.abilities.campaign.shrink import load_failure
from hil_bench.abilities.campaign.snapshot import perform_here
from hil_bench.abilities.controllers.python import examples as controllers
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.records import Controller, Scenario
from hil_bench.abilities.scenario.run import play, prepare
from hil_bench.abilities.scenario.writing import to_toml

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "benchmarks" / "defects"
FIRMWARE = ROOT / "examples" / "firmware"
DRIVERS = Path(str(hil_drivers.__file__)).parent


@dataclass(frozen=True)
class Defect:
    """A change of one place; see defects.toml."""

    id: str
    language: str
    file: str
    what: str
    old: str
    new: str

    def source(self) -> str:
        """Return the text of the file with the defect."""
        folder = DRIVERS if self.language == "py" else FIRMWARE
        text = (folder / self.file).read_text(encoding="utf-8")
        if text.count(self.old) != 1:
            sys.exit(f"{self.id}: its place is {text.count(self.old)} times in {self.file}")
        return text.replace(self.old, self.new)


def load_defects() -> list[Defect]:
    """Return all defects."""
    document = tomllib.loads((FOLDER / "defects.toml").read_text(encoding="utf-8"))
    return [Defect(**each) for each in document["defect"]]


@contextmanager
def seeded(defect: Defect | None, language: str) -> Iterator[Scenario]:
    """Seed a defect; None leaves the controller as it is.

    Yields:
        The scenario of the controller.
    """
    if language == "py":
        with _patched(defect):
            yield load_scenario(FOLDER / "python.scenario.toml")
        return
    scenario = load_scenario(FOLDER / "firmware.scenario.toml")
    with tempfile.TemporaryDirectory(prefix="hil-bench-") as folder:
        program = build_firmware(defect, Path(folder))
        words = scenario.controller.firmware if scenario.controller else ()
        yield replace(scenario, controller=Controller((str(program), *words[1:])))


def build_firmware(defect: Defect | None, folder: Path) -> Path:
    """Return the program of a copy of the firmware."""
    copy = folder / "firmware"
    shutil.copytree(FIRMWARE, copy, ignore=shutil.ignore_patterns("build", "*.py"))
    if defect is not None:
        (copy / defect.file).write_text(defect.source(), encoding="utf-8")
    subprocess.run(["make", "-s", "CFLAGS=-O2 -Wno-error"], cwd=copy, check=True)  # noqa: S607
    return copy / "build" / "position_control"


@contextmanager
def _patched(defect: Defect | None) -> Iterator[None]:
    if defect is None:
        yield
        return
    module = types.ModuleType(f"defect_{defect.id}")
    sys.modules[module.__name__] = module  # where dataclasses look for it
    exec(compile(defect.source(), defect.file, "exec"), module.__dict__)  # noqa: S102 - our own
    names = [name for name in vars(module) if name in vars(controllers) and name[0].isupper()]
    own = {name: getattr(controllers, name) for name in names}
    for name in names:
        setattr(controllers, name, getattr(module, name))
    try:
        yield
    finally:
        for name, value in own.items():
            setattr(controllers, name, value)
        del sys.modules[module.__name__]


def first_failure(scenario: Scenario, method: Method, runs: int, seed: int) -> int | None:
    """Return the number of the first run that fails; None where none does."""
    searcher = Searcher(own_case(scenario), space_of(scenario), perform_here)
    for trial in searcher.trials(method, runs, seed):
        if trial.result.outcome.is_failure:
            return trial.number
    return None


def false_counterexamples(defect: Defect, runs: int, seed: int) -> tuple[int, list[str]]:
    """Count the shrunk failures, and list those that the sound controller fails, too."""
    plan = SearchPlan((Method.SOBOL,), Budget(runs), seed, ends_at_failure=True)
    with tempfile.TemporaryDirectory(prefix="hil-bench-") as name:
        folder = Path(name)
        with seeded(defect, defect.language) as scenario:
            path = folder / scenario.path.name
            path.write_text(to_toml(scenario), encoding="utf-8")
            found = falsify(path, plan, perform_here, folder / "failures", lambda _result: None)
        failures = [load_failure(each.files) for each in found.failures if each.files]
        wrong = []
        with seeded(None, defect.language) as sound:
            for small in failures:
                run = play(prepare(replace(small, controller=sound.controller)))
                if any(each.judgement.outcome != "passed" for each in run.findings):
                    wrong.append(f"{small.path.name}: {run.findings}")
        return len(failures), wrong


def count_false_counterexamples(defects: list[Defect], runs: int, seed: int) -> None:
    """Search each defect, and play its shrunk failures with the controller as it is."""
    total = bad = 0
    for defect in defects:
        count, wrong = false_counterexamples(defect, runs, seed)
        total, bad = total + count, bad + len(wrong)
        print(f"{defect.id:24}{count} shrunk, {len(wrong)} false", *wrong, sep="\n  ", flush=True)
    print(f"{bad} of {total} shrunk failures are false")


def processor_time() -> float:
    """Return the processor time of this program and of those that it waited for [s]."""
    usages = [getrusage(who) for who in (RUSAGE_SELF, RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in usages)


def count_false_alarms(language: str, runs: int, seed: int) -> None:
    """Play the controller as it is."""
    with seeded(None, language) as scenario:
        searcher = Searcher(own_case(scenario), space_of(scenario), perform_here)
        alarms = 0
        for trial in searcher.trials(Method.RANDOM, runs, seed):
            if trial.result.outcome.is_failure:
                alarms += 1
                print(f"false alarm: {trial.result}")
        print(f"{language}: {alarms} false alarms in {runs} runs", flush=True)


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--language", choices=["py", "c"], help="both without it")
    parser.add_argument("--only", nargs="+", metavar="ID", help="of defects.toml")
    parser.add_argument("--method", choices=list(ALL_METHODS), type=Method, help="all without it")
    parser.add_argument("--runs", type=int, default=40, help="of each method (%(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--sound", type=int, metavar="N", help="count false alarms in N runs")
    parser.add_argument("--shrunk", action="store_true", help="count false shrunk failures")
    options = occasion.arguments(parser, runs=2, only=["wind_up"], language="py")
    if options.sound:
        for language in [options.language] if options.language else ["py", "c"]:
            count_false_alarms(language, options.sound, options.seed)
        return
    methods = [options.method] if options.method else ALL_METHODS
    found = dict.fromkeys(methods, 0)
    used_s = dict.fromkeys(methods, 0.0)
    chosen = [
        each
        for each in load_defects()
        if options.language in {None, each.language} and each.id in (options.only or [each.id])
    ]
    if options.shrunk:
        count_false_counterexamples(chosen, options.runs, options.seed)
        return
    for defect in chosen:
        line = f"{defect.language:7}{defect.id:24}"
        with seeded(defect, defect.language) as scenario:
            for method in methods:
                start_s = processor_time()
                number = first_failure(scenario, method, options.runs, options.seed)
                used_s[method] += processor_time() - start_s
                found[method] += number is not None
                line += f"{method} {number or '-':>4}   "
        print(line, flush=True)
    total = ", ".join(f"{method} {found[method]} ({used_s[method]:.0f} s)" for method in methods)
    print(f"found of {len(chosen)} in {options.runs} runs, and processor time: {total}")


if __name__ == "__main__":
    main()
