"""Python and the libraries."""

import importlib.metadata
import platform
import sys
from typing import Any

from hil_bench.bench.compiled import HOW, Core, look_at_core
from hil_bench.plants.hydraulic_cylinder.model.implicit_midpoint import advance_implicit_midpoint
from hil_bench.plants.hydraulic_cylinder.model.kernel import IS_COMPILED, IS_INSTALLED, ready
from hil_bench.session.doctor.finding import Finding, Topic, Verdict, good

_LIBRARIES = ("numpy", "python-can", "canopen")
_INTERPRETED = "the plant takes 57 us of a tick in place of 2"


def examine_software() -> Topic:
    """Return what Python and the libraries are like; a bench has been built before."""
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
    name = "plant kernel"
    if not IS_COMPILED:
        advice = f"pip install 'hil-bench[fast]'; {_INTERPRETED}"
        if IS_INSTALLED:
            advice = f"unset NUMBA_DISABLE_JIT; {_INTERPRETED}"
        return Finding(name, Verdict.HINT, "interpreted", advice)
    statistics: Any = ready(advance_implicit_midpoint).stats  # type: ignore[attr-defined]  # Numba's
    version = f"compiled by Numba {importlib.metadata.version('numba')}"
    if statistics.cache_path is None:
        advice = "NUMBA_CACHE_DIR=DIR names a directory of yours, or each start compiles for 1 s"
        return Finding(name, Verdict.HINT, f"{version}, nowhere to cache it", advice)
    how = "cached" if statistics.cache_hits else "cached now"
    return good(name, f"{version}, {how} in {statistics.cache_path}")
