"""The short pieces into which a record is cut."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.record import AxisRecord

_SMOOTHED = 4  # rows on each side of which a start is smoothed
KEPT_OFF = 3e-3
"""What a piece keeps off the end stops [m], whose contact the record does not resolve."""


class Pieces(NamedTuple):
    """A selection of a record's pieces.

    Attributes:
        rows: where each starts, ascending.
        length: rows of each.
    """

    rows: npt.NDArray[np.int64]
    length: int

    def touching(self, record: AxisRecord) -> npt.NDArray[np.bool_]:
        """Return in which pieces the piston touches an end stop."""
        if record.at_stop is None:
            return np.zeros(len(self.rows), dtype=np.bool_)
        rows = self.rows[:, np.newaxis] + np.arange(self.length + 1)
        return np.asarray(record.at_stop[rows, 0].any(axis=1))

    def share(self, share: float, most: int | None = None) -> "Pieces":
        """Return some of the pieces, spread evenly by chance; the same at each call."""
        count = max(1, round(share * len(self.rows)))
        count = count if most is None else min(count, most)
        chosen = np.random.default_rng(3).permutation(len(self.rows))[:count]
        return Pieces(np.sort(self.rows[chosen]), self.length)

    def chosen(self, which: npt.NDArray[np.bool_]) -> "Pieces":
        """Return the pieces that are marked."""
        return Pieces(self.rows[which], self.length)


def cut_pieces(
    record: AxisRecord,
    parts: Sequence[range],
    length: int,
    stroke_end: float,
    *,
    has_stops: bool = False,
) -> Pieces:
    """Return the pieces of parts of a record that stay clear of the end stops.

    Args:
        record: what to cut.
        parts: the rows that may be used, without gaps in each.
        length: of each piece, in rows.
        stroke_end: position of the stops [m].
        has_stops: whether pieces at the stops that the record marks are among them.
    """
    starts = np.concatenate(
        [np.arange(part.start, part.stop - length, length, dtype=np.int64) for part in parts]
    )
    if record.clipped is not None:
        # A piece that starts where a sensor shows nothing has no start.
        near = starts[:, np.newaxis] + np.arange(-_SMOOTHED, _SMOOTHED + 1)
        starts = starts[~record.clipped[np.clip(near, 0, len(record) - 1)].any(axis=(1, 2))]
    reach = [np.abs(record.measured[row : row + length + 1, 0]).max() for row in starts]
    pieces = Pieces(starts, length)
    is_clear = np.array(reach, dtype=np.float64) < stroke_end - KEPT_OFF
    return pieces.chosen(is_clear | pieces.touching(record) if has_stops else is_clear)
