"""Files and folders that verbs write: whole or not at all, and scratch ones."""

import contextlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hil_bench.errors import ConfigError, about_file, check_replaceable
from hil_bench.scratch import ScratchFolder


@contextlib.contextmanager
def whole_file(path: Path, *, replaces: bool = False) -> Iterator[Path]:
    """Have a file written whole, or left as it was; see `check_replaceable`.

    Args:
        path: the file; a device, a pipe or a link is written where it is.
        replaces: any file that is there, since somebody has asked for it.

    Yields:
        The file to write, which takes its place at the end of the block.
    """
    if not replaces:
        check_replaceable(path)
    if path.is_symlink() or (path.exists() and not path.is_file()):
        yield path
        return
    partial = path.with_name(f".{os.getpid()}.{path.name}")
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def check_place(option: str, path: Path) -> None:
    """Refuse, before anything runs, a file that could not be written at the end.

    Raises:
        ConfigError: its folder is missing or read-only, or somebody else's file is there.
    """
    folder = path.absolute().parent
    if not folder.is_dir():
        raise ConfigError(f"{option} {path}: there is no folder {path.parent}; make it first")
    if path.is_dir():
        raise ConfigError(f"{option} {path}: is a directory; give the name of a file")
    if (path.is_file() or not path.exists()) and not os.access(folder, os.W_OK):
        raise ConfigError(f"{option} {path}: its folder is read-only; give a file in one of yours")
    check_replaceable(path)


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """Have a temporary folder for the time of the block.

    Yields:
        Its path.
    """
    folder = ScratchFolder()
    try:
        yield folder.path
    finally:
        folder.remove()


def make_directory(path: Path) -> None:
    """Make the output directory where it is not there yet."""
    with about_file(f"--output {path}", what="cannot be made", right="give a directory of yours"):
        path.mkdir(parents=True, exist_ok=True)
