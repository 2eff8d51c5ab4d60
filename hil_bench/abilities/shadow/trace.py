"""The trace of an axis' twin over the last ticks."""

from collections import deque
from collections.abc import Mapping
from typing import NamedTuple


class Row(NamedTuple):
    """The twin at the end of one tick.

    Attributes:
        time: of the tick's end [s].
        values: what each device would say without noise, by its name, in SI units.
    """

    time: float
    values: dict[str, float]


class Trace:
    """The last rows, to compare values of the machine with that are older than the twin's present.

    Args:
        length: how many rows are kept.
    """

    def __init__(self, length: int) -> None:
        self._rows: deque[Row] = deque(maxlen=length)

    def append(self, row: Row) -> None:
        """Take the newest row."""
        self._rows.append(row)

    def clear(self) -> None:
        """Forget all rows."""
        self._rows.clear()

    def shift(self, offsets: Mapping[str, float]) -> None:
        """Move all rows by what the twin was moved by."""
        for _, values in self._rows:
            for name, offset in offsets.items():
                values[name] += offset

    def at(self, name: str, time: float) -> float:
        """Return the value at a time [s], interpolated; beyond either end, that of the end."""
        rows = self._since(time)
        if len(rows) == 1:
            return rows[0].values[name]
        return _between(rows[0], rows[1], name, time)

    def distance(self, name: str, value: float, begin: float, end: float) -> float:
        """Return the distance of a value beyond all of the twin's from `begin` to `end` [s].

        Args:
            name: of the device.
            value: what the machine's says.
            begin: when it was measured at the earliest [s].
            end: when at the latest [s].

        Returns:
            The value less the nearest of the twin's; 0 if it lies among them.
        """
        rows = self._since(begin)
        found = [self.at(name, begin), self.at(name, end)]
        found += [row.values[name] for row in rows if begin <= row.time <= end]
        return value - min(max(value, min(found)), max(found))

    def _since(self, time: float) -> list[Row]:
        """Return the rows from the last one that is not after a time on; at least one."""
        found: list[Row] = []
        for row in reversed(self._rows):
            found.append(row)
            if row.time <= time:
                break
        found.reverse()
        return found


def _between(before: Row, after: Row, name: str, time: float) -> float:
    share = min(max((time - before.time) / (after.time - before.time), 0.0), 1.0)
    value = before.values[name]
    return value + share * (after.values[name] - value)
