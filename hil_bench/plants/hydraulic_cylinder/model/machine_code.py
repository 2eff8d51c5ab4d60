"""The plant's kernels as a wheel carries them: compiled by Numba ahead of time.

A wheel that was built with ``HIL_BENCH_COMPILE=1`` has the extension module `_kernels`. It is used
where it was made for this Python, of these very sources, and for instructions that this processor
has. Then a bench starts without Numba. Otherwise kernels are what `model.kernel` makes of them.
"""

import functools
import hashlib
import importlib
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

_MODEL: Final = Path(__file__).parent
_EXTENSION: Final = f"{__package__}._kernels"

WANTS_PYTHON: Final = os.environ.get("NUMBA_DISABLE_JIT", "0") not in {"", "0"}
"""Whether the environment asks for kernels that run as Python, of whatever origin they are."""


@dataclass(frozen=True, slots=True)
class MachineCode:
    """The compiled kernels of a wheel.

    Attributes:
        bind: returns a kernel by its name with the rows that it moves on; None: it is not used.
        compiler: what compiled it; empty where there is none.
        level: of the processors that it is for.
        refusal: why it is not used, though there is one; else empty.
    """

    bind: Callable[..., Callable[..., Any]] | None = None
    compiler: str = ""
    level: str = ""
    refusal: str = ""

    def __str__(self) -> str:
        return f"compiled ahead of time by {self.compiler} for {self.level}"


@functools.cache
def find_machine_code() -> MachineCode:
    """Return the compiled kernels of this installation for this process."""
    return MachineCode() if WANTS_PYTHON else examine(_EXTENSION, _MODEL)


def examine(extension: str, sources: Path) -> MachineCode:
    """Return the compiled kernels of an extension module, with the reason if they do not fit.

    Args:
        extension: its name.
        sources: the folder of the modules that it must be made of.
    """
    try:
        module = importlib.import_module(extension)
    except ModuleNotFoundError:  # a wheel without it, or another Python
        return MachineCode()
    except ImportError as error:
        return MachineCode(refusal=f"they do not load: {error}")
    made_of, compiler, level = module.SOURCES, module.COMPILER, module.LEVEL
    if missing := module.missing_instructions():
        refusal = f"this processor has no {', '.join(missing)}"
        return MachineCode(None, compiler, level, refusal)
    if made_of != fingerprint(sources):
        return MachineCode(None, compiler, level, f"{sources} was edited after they were compiled")
    return MachineCode(module.bind, compiler, level)


def fingerprint(folder: Path = _MODEL) -> str:
    """Return a digest of the names and contents of the modules in a folder."""
    digest = hashlib.sha256()
    for path in sorted(folder.glob("*.py")):
        content = path.read_bytes()
        digest.update(f"{path.name} {len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()
