"""Compiles libraries of ours at their first use; that of programs: ``python compile.py TARGET``.

It imports nothing of the package, since a wheel is built without it.
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

SOURCES = Path(__file__).parent / "preload"
FLAGS = (
    *("-std=c11", "-O2", "-Wall", "-Wextra", "-Werror"),
    *("-shared", "-fPIC", "-fvisibility=hidden", "-U_FORTIFY_SOURCE"),
)


class CompilerError(Exception):
    """There is no C compiler, or it refuses; the words say so in one line."""


def compile_library(target: Path) -> None:
    """Compile the library that is loaded before a program; see `compile_files`."""
    compile_files(target, sorted(SOURCES.glob("*.c")))


def compile_files(target: Path, sources: Sequence[Path], *flags: str) -> None:
    """Compile a shared library.

    Args:
        target: the file, which is replaced at once.
        sources: of it.
        flags: beside `FLAGS`.

    Raises:
        CompilerError: there is no compiler, or it refuses.
    """
    compiler = shutil.which(os.environ.get("CC", "") or "cc")
    if compiler is None:
        raise CompilerError("there is no C compiler (cc)")
    partial = target.with_name(f".{os.getpid()}.{target.name}")
    command = [compiler, *FLAGS, *flags, "-o", str(partial), *map(str, sources)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - ours
    if done.returncode:
        wrong = [line for line in done.stderr.splitlines() if "error" in line] or [compiler]
        raise CompilerError(f"the C compiler refuses: {wrong[0]}")
    partial.replace(target)


if __name__ == "__main__":
    try:
        compile_library(Path(sys.argv[1]))
    except CompilerError as error:
        sys.exit(str(error))
