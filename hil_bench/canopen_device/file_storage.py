"""Storage in a file: replaced atomically, with a checksum that tells a damaged one.

The file is one line of text, `hil-bench parameters 1 crc32 ` and eight hexadecimal digits, and then
the data, whose CRC-32 those are. It is written beside the old one, flushed to the disk and renamed,
so a power failure leaves either the old file or the new one.
"""

import contextlib
import os
import re
import tempfile
from pathlib import Path
from typing import Final
from zlib import crc32

from hil_bench.canopen_device.errors import StorageError

_HEADER: Final = re.compile(rb"hil-bench parameters (\d{1,9}) crc32 ([0-9a-f]{8})\n")
_VERSION: Final = 1
_LARGEST: Final = 1 << 24
"""Size beyond which a file is none of ours [byte]."""


class FileStorage:
    """Keeps the data of one device in the file at `path`, whose folder is made when needed."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def read(self) -> bytes | None:
        """Return the content written last; None where there is no file.

        `StorageError` where it cannot be read, is damaged or of another version.
        """
        try:
            with self._path.open("rb") as file:
                content = file.read(_LARGEST + 1)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise self._error(error.strerror or str(error)) from error
        return self._check(content)

    def write(self, data: bytes) -> None:
        """Replace the file.

        Raises:
            StorageError: that failed; the old data or the new are in it.
        """
        header = f"hil-bench parameters {_VERSION} crc32 {crc32(data):08x}\n"
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._replace(header.encode() + data)
        except OSError as error:
            what = f"cannot be written: {error.strerror or error}"
            raise StorageError(f"{self._path}: {what}; what was stored before stays") from error

    def _check(self, content: bytes) -> bytes:
        header = _HEADER.match(content)
        if header is None or len(content) > _LARGEST:
            raise self._error("is no file of stored parameters")
        if int(header[1]) != _VERSION:
            raise self._error(f"has version {int(header[1])}, this program reads {_VERSION}")
        data = content[header.end() :]
        if crc32(data) != int(header[2], 16):
            raise self._error("is damaged: its checksum does not fit")
        return data

    def _replace(self, content: bytes) -> None:
        descriptor, name = tempfile.mkstemp(prefix=self._path.name, dir=self._path.parent)
        try:
            _write(descriptor, content)
            Path(name).replace(self._path)
        except OSError:
            with contextlib.suppress(OSError):
                Path(name).unlink()
            raise
        _flush_folder(self._path.parent)

    def _error(self, what: str) -> StorageError:
        right = "mend or delete it; the device runs on its defaults"
        return StorageError(f"{self._path}: {what}; {right}")


def _write(descriptor: int, content: bytes) -> None:
    """Have the content on the disk, and close the file.

    Raises:
        OSError: it is not there.
    """
    try:
        file = os.fdopen(descriptor, "wb")
    except OSError:
        os.close(descriptor)
        raise
    with file:
        file.write(content)
        file.flush()
        os.fsync(descriptor)


def _flush_folder(folder: Path) -> None:
    """Bring the renaming to the disk too; Windows does that by itself."""
    if os.name == "nt":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
