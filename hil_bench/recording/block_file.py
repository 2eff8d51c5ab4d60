"""Files that are written in blocks while the bench runs."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from hil_bench.errors import ConfigError, RecordingError
from hil_bench.recording.channels import Recording
from hil_bench.recording.logged_frame import LoggedFrame


class BlockFile(Protocol):
    """A file of a recording; what its format has no place for, it leaves out.

    After an `OSError` from any method the file ends with the last complete block.
    """

    path: Path

    def write_rows(self, rows: Recording) -> None:
        """Append rows of signals."""

    def write_frames(self, frames: Sequence[LoggedFrame]) -> None:
        """Append frames."""

    def flush(self, *, durable: bool) -> None:
        """Put on the disk what was written; see `OutputFile.flush`."""

    def close(self) -> None:
        """Close the file."""


class OutputFile:
    """A file to append to, in which written bytes may be replaced later.

    Args:
        path: the file; one that is there is replaced.

    Raises:
        ConfigError: it cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._file = path.open("wb", buffering=0)
        except OSError as error:
            raise unwritable(path, error) from None
        self._end = 0

    def append(self, data: bytes) -> int:
        """Write at the end, and return the address.

        Raises:
            OSError: it could not be written whole; then none of it is in the file.
        """
        address = self._end
        try:
            self._write(address, data)
        except OSError:
            self._file.truncate(address)
            raise
        self._end += len(data)
        return address

    def overwrite(self, address: int, data: bytes) -> None:
        """Replace bytes."""
        self._write(address, data)

    def flush(self, *, durable: bool) -> None:
        """Make sure that what was written is in a file with our name.

        Args:
            durable: have it on the disk, where a power cut leaves it, not only with the system.
        """
        make_safe(self.path, self._file.fileno(), durable=durable)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _write(self, address: int, data: bytes) -> None:
        self._file.seek(address)
        view = memoryview(data)
        while view:
            view = view[self._file.write(view) :]


def make_safe(path: Path, descriptor: int, *, durable: bool) -> None:
    """Make sure that an open file still has its name; see `OutputFile.flush`.

    Raises:
        RecordingError: it has been removed, renamed or replaced.
    """
    try:
        there = os.path.samestat(path.stat(), os.fstat(descriptor))
    except OSError:
        there = False
    if not there:
        raise RecordingError("the file or its folder has vanished")
    if durable:
        os.fsync(descriptor)


def unwritable(path: Path, error: OSError) -> ConfigError:
    """Return the error for a file that cannot be opened for writing."""
    if path.is_dir():
        return ConfigError(f"{path}: is a directory; give the name of a file to write")
    return ConfigError(
        f"{path}: cannot be written: {error.strerror}; give a file in a directory of yours"
    )
