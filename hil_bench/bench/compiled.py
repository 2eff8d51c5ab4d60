"""The state of the bench's core: compiled or interpreted, and from which sources.

A wheel that was built with ``HIL_BENCH_COMPILE=1`` carries modules compiled by mypyc, and in
`compiled.json` a digest of the source of each. Python takes the compiled module where there is one
for its version, so an edit of the source beside it has no effect. The sources that run otherwise
are the same.
"""

import functools
import hashlib
import json
import logging
from dataclasses import dataclass
from pathlib import Path

import hil_bench
from hil_bench.canopen_device import agenda

logger = logging.getLogger(__name__)

HOW = "HIL_BENCH_COMPILE=1 pip install . in a checkout, with a C compiler: three times the speed"

_PACKAGE = Path(hil_bench.__file__ or "").parent


@dataclass(frozen=True, slots=True)
class Core:
    """The core that runs: compiled or interpreted.

    Attributes:
        compiler: what compiled the modules, empty where they run as Python.
        modules: how many there are.
        edited: those of them whose source is not the one that was compiled.
    """

    compiler: str
    modules: int
    edited: tuple[str, ...]

    def __str__(self) -> str:
        if not self.compiler:
            return "interpreted"
        edited = f"; edited since, without effect: {', '.join(self.edited)}" if self.edited else ""
        return f"{self.modules} modules compiled by {self.compiler}{edited}"


def look_at_core(package: Path = _PACKAGE, running: str | None = None) -> Core:
    """Find out if the core that runs is compiled, and which modules were edited since.

    Args:
        package: the folder of `hil_bench`.
        running: the file of one of the modules in question; None for that of this process.
    """
    file = agenda.__file__ if running is None else running
    try:
        record = json.loads((package / "compiled.json").read_text("utf-8"))
        compiler, digests = f"mypyc {record['mypyc']}", dict(record["modules"])
    except (OSError, ValueError, KeyError, TypeError):
        compiler, digests = "mypyc", {}
    if file.endswith(".py"):
        return Core("", 0, ())
    edited = tuple(name for name, digest in digests.items() if _digest(package, name) != digest)
    return Core(compiler, len(digests), edited)


@functools.cache
def warn_of_edits() -> None:
    """Say it, once, where a source was edited after it was compiled."""
    for name in look_at_core().edited:
        logger.warning(
            "%s was edited after it was compiled, and the edit has no effect; install again, or "
            "work in a checkout (pip install -e .), which runs as it is written",
            name,
        )


def _digest(package: Path, name: str) -> str:
    try:
        return hashlib.sha256((package.parent / name).read_bytes()).hexdigest()
    except OSError:
        return ""
