"""Files of recordings that are written: in blocks while the bench runs, or whole at its end."""

import contextlib
import csv
import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Self

from hil_bench.canopen_device.frame import BRS, ESI
from hil_bench.errors import ConfigError, RecordingError, about_file, check_replaceable, naming
from hil_bench.outside.recording.channels import LoggedFrame, Recording, recording_channels

BUS_LOGS = (".asc", ".blf", ".log")
"""Suffixes of what has frames alone and is written: Vector's ASC and BLF, candump's log."""

READ_LOGS = (*BUS_LOGS, ".trc")
"""Suffixes of what has frames alone and is read: PEAK's TRC, too."""


class BlockFile:
    """A file of a recording; what its format has no place for, it leaves out.

    After an `OSError` from any method the file ends with the last complete block.

    Args:
        path: the file; one that is there is replaced.
        head: what it begins with.

    Attributes:
        path: as passed in.

    Raises:
        ConfigError: it cannot be written.
    """

    def __init__(self, path: Path, head: bytes = b"") -> None:
        self.path = path
        self._file = OutputFile(path, head)

    def write_rows(self, rows: Recording) -> None:
        """Append rows of signals."""

    def write_frames(self, frames: Sequence[LoggedFrame]) -> None:
        """Append frames."""

    def flush(self, *, durable: bool) -> None:
        """Put on the disk what was written; see `OutputFile.flush`."""
        self._complete()
        self._file.flush(durable=durable)

    def close(self) -> None:
        """Write what is left and close the file."""
        try:
            self._complete()
        finally:
            self._file.close()

    def abandon(self) -> None:
        """Close the file as it is, after an `OSError`."""
        self._file.abandon()

    def _complete(self) -> None:
        """Append what waits in memory."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class OutputFile:
    """A file to append to, in which written bytes may be replaced later.

    Args:
        path: the file; one that is there is replaced.
        head: what it begins with.

    Attributes:
        path: as passed in.
        size: bytes in it.

    Raises:
        ConfigError: it cannot be written.
    """

    def __init__(self, path: Path, head: bytes = b"") -> None:
        self.path = path
        self.size = 0
        with opening(path):
            self._file = path.open("wb", buffering=0)
            self._begin(head)

    def _begin(self, head: bytes) -> None:
        try:
            self.append(head)
        except OSError:
            self.abandon()
            raise

    def append(self, data: bytes) -> int:
        """Write at the end, and return the address.

        Raises:
            OSError: it could not be written whole; then none of it is in the file.
        """
        address = self.size
        try:
            self._write(address, data)
        except OSError:
            with contextlib.suppress(OSError):  # what is not there cannot be cut off either
                self._file.truncate(address)
            raise
        self.size += len(data)
        return address

    def overwrite(self, address: int, data: bytes) -> None:
        """Replace bytes."""
        self._write(address, data)

    def flush(self, *, durable: bool) -> None:
        """Make sure that what was written is in a file with our name.

        Args:
            durable: have it on the disk, where a power cut leaves it, not only with the system.

        Raises:
            RecordingError: the file or its folder has vanished.
        """
        if not self._is_still_there():
            raise RecordingError("the file or its folder has vanished")
        if durable:
            os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def abandon(self) -> None:
        """Close the file, whatever the system says to that."""
        with contextlib.suppress(OSError):
            self._file.close()

    def _write(self, address: int, data: bytes) -> None:
        view = memoryview(data)
        with naming(self.path):
            self._file.seek(address)
            while view:
                written = self._file.write(view)
                if not written:
                    raise RecordingError("the file takes no more")
                view = view[written:]

    def _is_still_there(self) -> bool:
        try:
            return os.path.samestat(self.path.stat(), os.fstat(self._file.fileno()))
        except (FileNotFoundError, NotADirectoryError):
            return False


@contextlib.contextmanager
def opening(path: Path) -> Iterator[None]:
    """Have an `OSError` at the opening of a file for writing come as a `ConfigError`.

    Yields:
        Nothing.

    Raises:
        ConfigError: the path is a directory, or cannot be written.
    """
    with about_file(path, right="give a file in a directory of yours"):
        if path.is_dir():
            raise ConfigError(f"{path}: is a directory; give the name of a file to write")
        check_replaceable(path)
        yield


# Our own files: signals as CSV with the names in the first row and the SI units in the second,
# frames as candump has them.
#
# Any table tool reads the CSV; with pandas: ``pandas.read_csv(path, skiprows=[1])``. Numbers are
# written so that they read back exactly.


class RecordingFile:
    """A CSV file that is opened before the run and written after it.

    The rows go to ``NAME.part`` beside it, which takes the place of the file once all is written,
    so a run that fails leaves the file of the last good run alone.

    Args:
        path: the CSV file.

    Raises:
        ConfigError: the file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._part = path.with_name(path.name + ".part")
        with opening(path):
            self._file = self._part.open("w", encoding="utf-8", newline="")

    def write(self, recording: Recording) -> None:
        """Write the whole recording and put the file in its place."""
        channels = recording_channels(recording)
        writer = csv.writer(self._file)
        with naming(self.path):
            writer.writerow(channel.name for channel in channels)
            writer.writerow(channel.unit for channel in channels)
            writer.writerows(recording.tolist())
            self._file.close()
        self._part.replace(self.path)

    def close(self) -> None:
        """Close the file; what was not written whole is removed."""
        with contextlib.suppress(OSError):  # `write` has closed what is to stay
            self._file.close()
        self._part.unlink(missing_ok=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class CandumpFile(BlockFile):
    """A log of frames, in lines as candump -L writes them."""

    def write_frames(self, frames: Iterable[LoggedFrame]) -> None:
        """Append a line a frame."""
        self._file.append("".join(map(_candump_line, frames)).encode())


def _candump_line(logged: LoggedFrame) -> str:
    frame, (seconds, nanoseconds) = logged.frame, divmod(logged.now, 1_000_000_000)
    digits = f"{frame.can_id:08X}" if frame.is_extended else f"{frame.can_id:03X}"
    data = "R" if frame.is_remote else frame.data.hex().upper()
    flags = f"#{frame.fd & (BRS | ESI)}" if frame.fd else ""
    return f"({seconds}.{nanoseconds // 1000:06d}) can{frame.bus} {digits}#{flags}{data}\n"
