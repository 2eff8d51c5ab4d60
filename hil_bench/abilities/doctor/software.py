"""Python and the libraries."""

import importlib.metadata
import platform
import sys
from typing import Any

from hil_bench.abilities.doctor.finding import Finding, Topic, Verdict, good
from hil_bench.bench.compiled import HOW, Core, look_at_core
from hil_bench.plants.hydraulic_cylinder.model.implicit_midpoint import advance_implicit_midpoint
from hil_bench.plants.hydraulic_cylinder.model.kernel import IS_COMPILED, ready
from hil_bench.plants.hydraulic_cylinder.model.machine_code import WANTS_PYTHON, find_machine_code
from hil_bench.plants.hydraulic_cylinder.model.moving import describe_kernels

_LIBRARIES = ("numpy", "python-can", "canopen")
_INTERPRETED = "the plant takes 57 us of a tick in place of 2"


def examine_software() -> Topic:
    """Return the findings on Python and the libraries; a bench has been built before."""
    versions = [f"{name} {importlib.metadata.version(name)}" for name in _LIBRARIES]
    return Topic(
        "Software",
        (
            good("Python", f"{platform.python_version()} ({sys.executable})"),
            good("libraries", ", ".join(versions)),
            _core(look_at_core()),
            _kernel(),
        ),
    )


def _core(core: Core) -> Finding:
    name = "core of the bench"
    if not core.compiler:
        return Finding(name, Verdict.HINT, str(core), HOW)
    if core.edited:
        return Finding(name, Verdict.HINT, str(core), "install again, or pip install -e a checkout")
    return good(name, str(core))


def _kernel() -> Finding:
    name, what = "plant kernel", describe_kernels()
    if find_machine_code().bind is not None:
        return good(name, what)
    if not IS_COMPILED:
        remedy = "unset NUMBA_DISABLE_JIT" if WANTS_PYTHON else "pip install 'hil-bench[fast]'"
        return Finding(name, Verdict.HINT, what, f"{remedy}; {_INTERPRETED}")
    if find_machine_code().refusal:
        return Finding(name, Verdict.HINT, what, "each start imports Numba, which takes 0.7 s")
    statistics: Any = ready(advance_implicit_midpoint).stats  # type: ignore[attr-defined]  # Numba's
    version = f"{what} {importlib.metadata.version('numba')}"
    if statistics.cache_path is None:
        advice = "NUMBA_CACHE_DIR=DIR names a directory of yours, or each start compiles for 1 s"
        return Finding(name, Verdict.HINT, f"{version}, nowhere to cache it", advice)
    how = "cached" if statistics.cache_hits else "cached now"
    return good(name, f"{version}, {how} in {statistics.cache_path}")
