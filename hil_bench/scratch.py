"""Temporary folders that a killed process does not leave behind for ever.

Each holds a locked file, and the system lets go of the lock of a process that is gone. The first
folder that a process makes removes those of this user that nobody holds.
"""

import os
import shutil
import sys
import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import IO

if sys.platform != "win32":  # where a killed process leaves its folders
    import fcntl

_PREFIX = "hil-bench-"
_LOCK = ".held"


class ScratchFolder:
    """A temporary folder, held until `remove`.

    Attributes:
        path: of the folder.
    """

    def __init__(self) -> None:
        _sweep(Path(tempfile.gettempdir()))
        self.path, self._lock = _make()

    def remove(self) -> None:
        """Remove the folder with all that is in it."""
        shutil.rmtree(self.path, ignore_errors=True)
        if self._lock is not None:
            self._lock.close()


def _make() -> tuple[Path, IO[bytes] | None]:
    """Return a new folder and its lock; another one where a sweep has come between the two."""
    while True:
        path = Path(tempfile.mkdtemp(prefix=_PREFIX))
        if sys.platform == "win32":
            return path, None
        with suppress(FileNotFoundError):
            lock = (path / _LOCK).open("ab")
            fcntl.flock(lock, fcntl.LOCK_EX)
            if (path / _LOCK).exists():
                return path, lock
            lock.close()


@cache
def _sweep(parent: Path) -> None:
    """Remove the folders that processes of this user have left, once in the life of this one."""
    if sys.platform == "win32":
        return
    for path in parent.glob(f"{_PREFIX}*/{_LOCK}"):
        with suppress(OSError):  # above all the BlockingIOError of a lock that somebody holds
            if path.lstat().st_uid == os.getuid():
                with path.open("rb") as lock:
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    shutil.rmtree(path.parent, ignore_errors=True)
