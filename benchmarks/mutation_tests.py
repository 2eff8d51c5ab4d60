"""The tests of a line: those fast ones that run it, as coverage has seen them.

The map is measured once, by pytest-cov, and kept in ``build``. The plant's kernels have one of
their own, for which they run as Python.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Final

from coverage import CoverageData

from mutation_areas import KERNELS

ROOT: Final = Path(__file__).resolve().parent.parent
SLOW: Final = ROOT / "tests" / "slow_tests.txt"
MOST: Final = 40  # tests of a mutant; those first whose file has most for its module
FAST: Final = ("-m", "not slow and not browser", "tests/unit", "tests/transcripts")
SLOWER: Final = ("-m", "not long", "tests/unit/eyes")
"""Nearly all logs that the eyes explain take more than 0.1 s to make."""

AS_PYTHON: Final = (
    "tests/unit/plant/test_balance.py",
    "tests/unit/plant/test_bristles.py",
    "tests/unit/plant/test_bulk_modulus.py",
    "tests/unit/plant/test_chamber.py",
    "tests/unit/plant/test_component_balance.py",
    "tests/unit/plant/test_cushion.py",
    "tests/unit/plant/test_data_sheet.py",
    "tests/unit/plant/test_elementary.py",
    "tests/unit/plant/test_extended.py",
    "tests/unit/plant/test_extensions.py",
    "tests/unit/plant/test_friction.py",
    "tests/unit/plant/test_full_order_refusals.py",
    "tests/unit/plant/test_lands.py",
    "tests/unit/plant/test_line_settings.py",
    "tests/unit/plant/test_lines.py",
    "tests/unit/plant/test_load.py",
    "tests/unit/plant/test_loads.py",
    "tests/unit/plant/test_mirrored.py",
    "tests/unit/plant/test_options.py",
    "tests/unit/plant/test_orifice.py",
    "tests/unit/plant/test_parameters.py",
    "tests/unit/plant/test_parts.py",
    "tests/unit/plant/test_spool.py",
    "tests/unit/plant/test_stability.py",
    "tests/unit/plant/test_state.py",
    "tests/unit/plant/test_supply.py",
    "tests/unit/plant/test_tank.py",
    "tests/unit/plant/test_waves.py",
    "tests/unit/plant/test_load_holding.py::test_the_lag_is_of_second_order_and_never_overshoots",
    "tests/unit/plant/test_load_holding.py::test_each_valve_has_a_state_and_a_pilot_of_its_own",
)
"""Those of the plants that are quick enough without Numba."""
SETTINGS: Final = "[run]\nsource_pkgs = hil_bench, hil_drivers\nrelative_files = true\n"


def is_kernel(path: Path) -> bool:
    """Return True if a module's tests have to run without Numba."""
    return str(path.relative_to(ROOT)).startswith(KERNELS)


def map_file(path: Path) -> Path:
    """Return the path of the map that a module is in."""
    return ROOT / "build" / f"mutation-{'python' if is_kernel(path) else 'fast'}.coverage"


def measure(path: Path, run: Callable[[Sequence[str], dict[str, str]], None]) -> None:
    """Measure the map that a module is in, unless it is there.

    Args:
        path: of the module.
        run: calls pytest in a process of its own, with options and environment.
    """
    file = map_file(path)
    if file.exists():
        return
    settings = file.with_suffix(".ini")
    settings.write_text(SETTINGS, encoding="utf-8")
    part = file.with_suffix(".part")
    options = ["--cov", f"--cov-config={settings}", "--cov-context=test", "--cov-report="]
    environment = {"COVERAGE_FILE": str(part), "NUMBA_DISABLE_JIT": str(int(is_kernel(path)))}
    if is_kernel(path):
        run([*options, "-m", "not slow", *AS_PYTHON], environment)
    else:
        run([*options, *FAST], environment)
        run([*options, "--cov-append", *SLOWER], environment)
    part.rename(file)


@cache
def _lines(file: Path, module: str) -> dict[int, list[str]]:
    data = CoverageData(str(file))
    data.read()
    return data.contexts_by_lineno(module)


def tests_of_line(path: Path, line: int) -> tuple[str, ...]:
    """Return the tests that run a line; for one that only an import runs, those of its module."""
    lines = _lines(map_file(path), str(path.relative_to(ROOT)))
    all_of_module = _functions(name for names in lines.values() for name in names)
    found = _functions(lines.get(line, [])) or all_of_module
    files = Counter(name.partition("::")[0] for name in all_of_module)
    slow = set(SLOW.read_text(encoding="utf-8").split())

    def rank(name: str) -> tuple[bool, int, str]:
        return name in slow, -files[name.partition("::")[0]], name

    return tuple(sorted(found, key=rank)[:MOST])


def _functions(contexts: Iterable[str]) -> list[str]:
    """Return the tests of some contexts, without parameters."""
    names = {name.rpartition("|")[0].partition("[")[0] for name in contexts}
    return sorted(names - {""})
