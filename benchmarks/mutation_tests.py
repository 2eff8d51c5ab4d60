"""The tests that have to notice a mutant: those that run its line, as coverage has seen them.

One run of the quick tests makes the map of all lines, and notes how long each test takes. The
kernels of the plants have a map of their own, in which they run as Python: what Numba has cached
has no mutant in it. Both are kept in ``build``.
"""

import ast
import os
import re
import subprocess
import sys
from collections import Counter, defaultdict
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from coverage import CoverageData

ROOT: Final = Path(__file__).resolve().parent.parent
BUILD: Final = ROOT / "build"
MODEL: Final = "hil_bench/plants/hydraulic_cylinder/model/"
FAST: Final = 0.5  # s of processor time, under coverage
MOST: Final = 20.0  # s of processor time for the tests of a mutant, as measured under coverage
QUICK: Final = ("bench", "contract", "generated", "referee", "transcripts", "unit")
"""Folders of tests; nothing that takes long, and nothing about pages and packages."""
AS_PYTHON: Final = """\
    balance bulk_modulus cavitation component_balance courses cushion data_sheet elementary extended
    extended_oil friction full_order full_order_limits full_order_refusals implicit_midpoint kernel
    lands line_settings lines loads mirrored options orifice parameters parts reduced_order
    shared_supply stability supply_pressure tank waves
    load_holding.py::test_the_lag_is_of_second_order_and_never_overshoots
    load_holding.py::test_each_valve_has_a_state_and_a_pilot_of_its_own"""
"""Those of the plants that are quick enough without Numba."""
SLOW_AS_PYTHON: Final = (
    "both_solvers or all_solvers or steady_speed or impact or top_speed or far_from or neither_made"
)
SETTINGS: Final = "[run]\nsource_pkgs = hil_bench, hil_drivers\nrelative_files = true\n"


def areas() -> dict[str, list[Path]]:
    """Return the modules of each package, of each ability and of the drivers."""
    package = ROOT / "hil_bench"
    folders = [file.parent for file in package.glob("*/__init__.py")]
    folders += [file.parent for file in package.glob("abilities/*/__init__.py")]
    folders = [ROOT / "drivers", *(each for each in sorted(folders) if each.name != "abilities")]
    return {each.name: modules(each) for each in folders}


def modules(path: Path) -> list[Path]:
    """Return the modules in a folder, or the one that the path is of."""
    return sorted(path.rglob("*.py")) if path.is_dir() else [path]


def tests_of_map(as_python: bool) -> list[str]:
    """Return the tests of a map, as pytest takes them."""
    if not as_python:
        return [f"tests/{folder}" for folder in QUICK]
    names = (name if "." in name else f"{name}.py" for name in AS_PYTHON.split())
    files = (f"tests/unit/plant/test_{name}" for name in names)
    return ["-m", "not slow", "-k", f"not ({SLOW_AS_PYTHON})", *files]


def is_kernel(path: Path) -> bool:
    """Return True if a module's tests have to run without Numba."""
    is_of_model = str(path.relative_to(ROOT)).startswith(MODEL)
    return is_of_model and "\n@kernel" in path.read_text(encoding="utf-8")


def tests_of_line(path: Path, line: int) -> list[str]:
    """Return the tests that run a line's statement: of what an import runs, all of the module.

    Fast ones come first, of these those whose file runs most lines of the module.
    """
    data, times = _map(is_kernel(path))
    reach = _reach(path, line)
    name = str(path.relative_to(ROOT))
    lines = data.contexts_by_lineno(name)
    if not any(map(_functions, lines.values())):  # only an import runs it
        lines = _of_folder(data, name)
    every = {each: _functions(contexts) for each, contexts in lines.items()}
    found = set[str]().union(*(every.get(each, ()) for each in reach))
    if not found or any("" in lines.get(each, ()) for each in reach):
        found = found.union(*every.values())
    found = {name for name in found if name.rpartition("::")[2] in _names(name.partition("::")[0])}
    files = Counter(
        file for tests in every.values() for file in {name.partition("::")[0] for name in tests}
    )

    def rank(name: str) -> tuple[bool, int, str]:
        return times[name] >= FAST, -files[name.partition("::")[0]], name

    chosen: list[str] = []
    taken = 0.0
    for name in sorted(found, key=rank):
        if not chosen or taken + times[name] <= MOST:
            chosen.append(name)
            taken += times[name]
    return chosen


def _of_folder(data: "CoverageData", name: str) -> dict[int, list[str]]:
    """Return all contexts of the modules beside one, as if of one line."""
    files = [file for file in data.measured_files() if Path(file).parent == Path(name).parent]
    contexts = (data.contexts_by_lineno(file).values() for file in files)
    return {0: list({each for found in contexts for names in found for each in names})}


def _reach(path: Path, line: int) -> Iterable[int]:
    """Return the lines of a function's statement; no lines for what an import runs."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    around = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.stmt) and node.lineno <= line <= (node.end_lineno or 0)
    ]
    if not any(
        isinstance(node, ast.FunctionDef) and node.body[0].lineno <= line for node in around
    ):
        return ()
    inner = max(around, key=lambda node: node.lineno)
    body = getattr(inner, "body", None)
    end = body[0].lineno if body else (inner.end_lineno or 0) + 1
    return range(inner.lineno, end) if line < end else (line,)  # or that of a handler


def _functions(contexts: Iterable[str]) -> set[str]:
    """Return the tests of some contexts, without parameters."""
    return {_function(context.rpartition("|")[0]) for context in contexts if context}


@cache
def _names(file: str) -> frozenset[str]:
    """Return the tests of a file, as it is now: some of the map may have moved since."""
    path = ROOT / file
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    return frozenset(re.findall(r"\bdef (test_\w+)", text))


def _function(name: str) -> str:
    return name.partition("[")[0]


@cache
def _map(as_python: bool) -> tuple["CoverageData", dict[str, float]]:
    """Return the tests of each line and the processor time of each test [s]; measure them once."""
    from coverage import CoverageData  # noqa: PLC0415 - README's tests run without it

    file = BUILD / f"mutation-{'python' if as_python else 'fast'}.coverage"
    times = file.with_suffix(".times")
    if not file.exists():
        _measure(file, times, as_python)
    data = CoverageData(str(file))
    data.read()
    taken: dict[str, float] = defaultdict(float)
    for part in times.iterdir():
        for entry in part.read_text(encoding="utf-8").splitlines():
            seconds, name = entry.split(" ", 1)
            taken[_function(name)] += float(seconds)
    return data, taken


def _measure(file: Path, times: Path, as_python: bool) -> None:
    times.mkdir(parents=True, exist_ok=True)
    settings = file.with_suffix(".ini")
    settings.write_text(SETTINGS, encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-q", "-n", "auto", *tests_of_map(as_python)]
    command += ["--cov", f"--cov-config={settings}", "--cov-context=test", "--cov-report="]
    part = file.with_suffix(".part")
    environment = {
        "COVERAGE_FILE": str(part),
        "HIL_BENCH_TEST_TIMES": str(times),
        "NUMBA_DISABLE_JIT": str(int(as_python)),
    }
    done = subprocess.run(command, check=False, env=os.environ | environment)  # noqa: S603 - ours
    if done.returncode:
        sys.exit("tests fail as they are, so they cannot judge mutants")
    part.rename(file)
