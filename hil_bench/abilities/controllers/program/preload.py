"""The library that is loaded before a program: of the wheel, or compiled at its first use."""

import hashlib
import os
import platform
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from hil_bench.abilities.controllers.program.compile import (
    FLAGS,
    SOURCES,
    CompilerError,
    compile_library,
)
from hil_bench.errors import ConfigError, ControllerFileError, about_file

INSTALLED = Path(__file__).with_name("_preload.so")
"""The library of a wheel that was built with the compiled core."""


@contextmanager
def _before_it_runs() -> Iterator[None]:
    """Have what is wrong here as a controller that cannot begin, and not as one that failed.

    Raises:
        ControllerFileError: something is.
    """
    try:
        yield
    except ConfigError as error:
        raise ControllerFileError(str(error)) from None


@_before_it_runs()
def find_library() -> Path:
    """Return the library, compiled now where no wheel or earlier run has brought it."""
    if INSTALLED.exists():
        return _loadable(INSTALLED)
    return _loadable(compiled_once(f"program-{_digest()}", "program", compile_library))


@_before_it_runs()
def compiled_once(
    name: str, kind: str, compile_to: Callable[[Path], None], needs: str = "gcc"
) -> Path:
    """Return a library of this user's own, compiled unless it is there.

    Args:
        name: of its file, with a digest of all that it is made of.
        kind: of controller that needs it.
        compile_to: compiles it to a file.
        needs: what is to be installed where that cannot be.

    Raises:
        ConfigError: a `ControllerFileError`, as there is no compiler, it refuses, the folder
            cannot be written, or others may write in it.
    """
    folder = cache_folder()
    library = folder / f"{name}.so"
    with about_file(folder):
        folder.mkdir(mode=0o755, parents=True, exist_ok=True)
        _check_owner(folder, kind)
    if not library.exists():
        with about_file(folder):
            try:
                compile_to(library)
            except CompilerError as error:
                raise ConfigError(
                    f'kind "{kind}": {error}; install {needs}, or a wheel that was built with '
                    "HIL_BENCH_COMPILE=1"
                ) from None
    return library


def cache_folder() -> Path:
    """Return the folder of this user in which compiled libraries are kept.

    Raises:
        ConfigError: the user has no home.
    """
    given = os.environ.get("XDG_CACHE_HOME", "")
    try:
        parent = Path(given) if Path(given).is_absolute() else Path.home() / ".cache"
    except RuntimeError:
        wrong = "this user has no home directory for compiled libraries"
        raise ConfigError(f"{wrong}; set XDG_CACHE_HOME to a folder") from None
    return parent / "hil-bench"


def _check_owner(folder: Path, kind: str) -> None:
    """Refuse a folder in which another user may have put a library.

    Raises:
        ConfigError: it is of another user than this one and root, or everybody may write in it.
    """
    if sys.platform == "win32":  # it has no such owners, and no folder for all there
        return
    found = folder.stat()
    if found.st_uid not in {os.getuid(), 0} or found.st_mode & stat.S_IWOTH:
        wrong = "other users may write in this folder of compiled libraries"
        raise ConfigError(f'kind "{kind}": {folder}: {wrong}; set XDG_CACHE_HOME to one of yours')


def _loadable(library: Path) -> Path:
    """Return a library whose path LD_PRELOAD can hold.

    Raises:
        ConfigError: it holds what parts a list there.
    """
    if any(sign in str(library) for sign in " :"):
        wrong = "a path with a blank or colon cannot be preloaded"
        raise ConfigError(f'kind "program": {library}: {wrong}; set XDG_CACHE_HOME to another')
    return library


@cache
def _digest() -> str:
    """Return a digest of all that the library is made of."""
    digest = hashlib.sha256(" ".join((*FLAGS, platform.machine())).encode())
    for path in sorted(SOURCES.glob("*.[ch]")):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]
