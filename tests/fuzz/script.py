"""A fuzzer's bytes as a script: steps of a few bytes each, whatever the bytes are."""

from collections.abc import Iterator


class Script:
    """Bytes that are taken from the front; what is beyond the end is zero."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._place = 0

    def __bool__(self) -> bool:
        return self._place < len(self._data)

    def take(self, count: int) -> bytes:
        """Return the next bytes, less where the script ends."""
        piece = self._data[self._place : self._place + count]
        self._place += count
        return piece

    def number(self, count: int = 1) -> int:
        """Return the next number, little-endian."""
        return int.from_bytes(self.take(count), "little")

    def steps(self, most: int) -> Iterator[int]:
        """Yield the first byte of each step, at most so many times."""
        for _ in range(most):
            if not self:
                return
            yield self.number()
