"""The end stops in a record: where they are, and what counts there.

A piston that stands at its stop tells compliance, delay and leakage by its pressures. How it came
to stand, its bounce, is that of the contact, which no data sheet has: the position does not count
while it touches, nor do the pressures right after it has struck.
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.pieces import KEPT_OFF
from hil_bench.abilities.identification.record import AxisRecord
from hil_bench.units import MILLIMETRE

_TOUCHING = 0.5e-3  # [m] from the furthest position at an end
_STRIKING = 0.01  # [s] after which the pressures count again
_LEAST = 0.05  # [s] at an end, or it is none
_UNEQUAL = 0.2e-3  # [m], by which both ends may differ


def find_stops(record: AxisRecord, stroke_end: float) -> AxisRecord:
    """Return a record with its rows at the end stops marked and named; the same if it has none.

    Args:
        record: to look through.
        stroke_end: position of the stops, as configured [m].
    """
    position = record.measured[:, 0]
    touches = np.zeros(len(record), dtype=np.bool_)
    ends = {}
    for sign in (1.0, -1.0):
        outward = sign * position
        furthest = float(np.quantile(outward, 1.0 - 1.0 / len(outward)))
        at_end = outward > furthest - _TOUCHING
        is_stop = abs(furthest - stroke_end) < KEPT_OFF
        if is_stop and at_end.sum() * record.interval > _LEAST:
            touches |= at_end
            ends[sign] = furthest
    if not ends:
        return record
    at_stop = np.repeat(touches[:, np.newaxis], 3, axis=1)
    at_stop[:, 1:] = _just_struck(touches, record.rows_in(_STRIKING))
    places = " and ".join(f"{MILLIMETRE.from_si(sign * end):.1f} mm" for sign, end in ends.items())
    notes = [f"end stop at {places}: pressures count there, positions do not"]
    if len(ends) > 1 and abs(ends[1.0] - ends[-1.0]) > _UNEQUAL:
        off = MILLIMETRE.from_si(0.5 * (ends[1.0] - ends[-1.0]))
        notes.append(
            f"the middle of both end stops is at {off:+.2f} mm; give the position an offset"
        )
    return replace(record, at_stop=at_stop, notes=(*record.notes, *notes))


def _just_struck(touches: npt.NDArray[np.bool_], rows: int) -> npt.NDArray[np.bool_]:
    """Return the rows in which a stop has been struck a moment ago, as a column."""
    struck = np.flatnonzero(touches[1:] & ~touches[:-1]) + 1
    marks = np.zeros(len(touches), dtype=np.bool_)
    for row in struck.tolist():
        marks[row : row + rows] = True
    return (marks & touches)[:, np.newaxis]
