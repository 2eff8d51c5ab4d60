"""Storage that survives a power cycle: a protocol, and memory as its simplest form."""

from typing import Protocol


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
