"""Storage of parameters: in files, whole or not at all, and the bytes that are stored."""

import contextlib
import json
import os
import re
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Protocol
from zlib import crc32

from hil_bench.canopen_device.errors import StorageError

# Storage that survives a power cycle: a protocol, and memory as its simplest form.


class Storage(Protocol):
    """Non-volatile memory of one device: one piece of data, replaced as a whole or not at all."""

    def read(self) -> bytes | None:
        """Return the content written last; None where nothing was written.

        `StorageError` where it cannot be read or is damaged.
        """

    def write(self, data: bytes) -> None:
        """Replace what was written before; `StorageError` where that fails, the old data stay."""


class MemoryStorage:
    """Storage that lives as long as this object: for tests, and for a bench without files."""

    def __init__(self) -> None:
        self._data: bytes | None = None

    def read(self) -> bytes | None:
        """Return the content written last; None where nothing was written."""
        return self._data

    def write(self, data: bytes) -> None:
        """Replace what was written before."""
        self._data = data


# Storage in a file: replaced atomically, with a checksum that tells a damaged one.
#
# The file is one line of text, `hil-bench parameters 1 crc32 ` and eight hexadecimal digits, and
# then the data, whose CRC-32 those are. It is written beside the old one, flushed to the disk and
# renamed, so a power failure leaves either the old file or the new one.

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


# The stored parameters of a device as JSON text, which a person can read and compare.

Identity = tuple[int, int, int]
"""Vendor-ID, product code and revision number: whose parameters these are (0x1018)."""


@dataclass(frozen=True, slots=True)
class StoredParameters:
    """The contents of a device's non-volatile memory.

    Attributes:
        identity: of the device that stored them.
        node_id: node-ID that LSS stored, None where it did not.
        bit_timing: index of the bit timing that LSS stored, None where it did not.
        values: objects whose value differs from the default, by index and sub-index, as an SDO
            transfer carries them.
    """

    identity: Identity
    node_id: int | None = None
    bit_timing: int | None = None
    values: Mapping[tuple[int, int], bytes] = field(default_factory=dict)

    def encode(self) -> bytes:
        """Return the text."""
        document = {
            "identity": list(self.identity),
            "node_id": self.node_id,
            "bit_timing": self.bit_timing,
            "objects": {
                f"{index:04X}.{subindex:02X}": raw.hex()
                for (index, subindex), raw in sorted(self.values.items())
            },
        }
        return json.dumps(document, indent=1).encode() + b"\n"

    @classmethod
    def decode(cls, data: bytes) -> "StoredParameters":
        """Return the contents of a text that `encode` made.

        Raises:
            StorageError: it is another one.
        """
        try:
            document = json.loads(data)
            vendor, product, revision = map(_number, document["identity"])
            return cls(
                identity=(vendor, product, revision),
                node_id=_optional_number(document["node_id"]),
                bit_timing=_optional_number(document["bit_timing"]),
                values={
                    _multiplexer(name): bytes.fromhex(raw)
                    for name, raw in document["objects"].items()
                },
            )
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise StorageError(f"the stored parameters are malformed: {error!r}") from error


def _multiplexer(name: str) -> tuple[int, int]:
    index, subindex = name.split(".")
    return int(index, 16), int(subindex, 16)


def _number(value: object) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise TypeError(value)
    return value


def _optional_number(value: object) -> int | None:
    return None if value is None else _number(value)
