"""The part of recordings that identification reads, checked: one axis, SI units, even steps."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Self

import numpy as np
import numpy.typing as npt

from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import TIME, Recording

Values = npt.NDArray[np.float64]

NEEDED = ("position", "spool_setpoint")
"""Quantities of an axis that a recording must have, beside one of the pressures."""

PRESSURES = ("P_A", "P_B")

SIGNALS = ("position", *PRESSURES)
"""Quantities that the model is held against, in the order of every array of them."""

FLOORS = (0.3e-6, 1e3, 1e3)
"""Noise of `SIGNALS` below which nothing is gained [m], [Pa]."""

_SHORTEST = 3.0  # [s] of all recordings together
_SLOWEST = 0.01  # [s] between rows: above, the pressures' oscillation is not seen
_ROUNDED = 1e-6  # of a row: times in a file are rounded
_UNEVEN = 0.2  # of a row: a step that is off by more is a gap
_HALF = 0.5  # of a recording must be whole for so long
_LEAST_STRETCH = 0.3  # [s] between two gaps: what is shorter does not serve
_ORDER = 8  # of the differences that show noise
_BLOCK = 32  # rows over which their power is averaged
_QUIET = 0.1  # of these blocks
_QUIET_POWER = 0.480  # that quantile for white noise of power 1, from 10^8 normal numbers
_MULTIPLE, _NEARLY_ALL = 0.01, 0.9  # how close to one, and of the steps
_MOTION = 1e-3  # [m]
_PACE = 50  # rows between two positions of which the way is counted: noise adds up less
_ONE_WAY = 0.05  # of the way: less back than that is one way only


class Session(NamedTuple):
    """One recording of those that are fitted together.

    Attributes:
        name: of its file.
        rows: its rows.
        has: which of `SIGNALS` it has, shape (3,).
    """

    name: str
    rows: range
    has: npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisRecord:
    """The record of one axis; nothing in it reaches across a gap in time.

    Attributes:
        axis: its name.
        times: of each row, from the start of its recording, shape (rows,) [s].
        interval: between two rows, but for gaps [s].
        stretches: the rows between two gaps.
        full_opening: spool position that a set-point of 1 stood for [m].
        setpoints: of the spool, each held over the interval that its row ends, shape (rows,) [m].
        measured: position [m], P_A and P_B [Pa], shape (rows, 3); not a number where a recording
            lacks a pressure.
        noise: standard deviation of each of `measured`, shape (3,); infinite where no recording
            has the signal.
        sessions: the recordings, one after the other.
        notes: what was found out about the columns.
        clipped: which of `measured` are at the end of their sensor's range, shape (rows, 3).
        is_sampled: whether a row has the set-point of its moment, as that of a logger, rather than
            of the interval before.
    """

    axis: str
    times: Values
    interval: float
    stretches: tuple[range, ...]
    full_opening: float
    setpoints: Values
    measured: Values
    noise: Values
    sessions: tuple[Session, ...] = ()
    notes: tuple[str, ...] = ()
    clipped: npt.NDArray[np.bool_] = field(default_factory=lambda: np.empty((0, 3), np.bool_))
    is_sampled: bool = False

    def __post_init__(self) -> None:
        if not self.sessions:
            has = np.array([np.isfinite(signal).all() for signal in self.measured.T])
            whole = Session("", range(len(self)), has)
            object.__setattr__(self, "sessions", (whole,))
        if not len(self.clipped):
            object.__setattr__(self, "clipped", np.zeros((len(self), 3), dtype=np.bool_))

    def __len__(self) -> int:
        return len(self.setpoints)

    def session_of(self, row: int) -> int:
        """Return the number of the recording that a row belongs to."""
        return next(n for n, session in enumerate(self.sessions) if row in session.rows)

    def split_at(self, rows: Sequence[int]) -> Self:
        """Return the record with gaps in time behind some rows.

        Raises:
            ConfigError: hardly anything is long enough between them.
        """
        kept = tuple(
            piece for part in self.stretches for piece in _pieces(part, rows, self.interval)
        )
        whole, span = (self.interval * sum(map(len, parts)) for parts in (self.stretches, kept))
        if span < _HALF * whole:
            raise ConfigError(
                f"the recording lacks rows in {len(rows)} places behind an even column of time, "
                f"the first at {self.times[min(rows)]:g} s; {span:.3g} s of it are whole for "
                f"{_LEAST_STRETCH:g} s and more"
            )
        return replace(self, stretches=kept)

    @property
    def moves_both_ways(self) -> bool:
        """Return True if the piston goes each way by a twentieth of its way and more than noise."""
        ways = [
            np.diff(self.measured[part.start : part.stop : _PACE, 0]) for part in self.stretches
        ]
        way = np.concatenate(ways)
        forth, back = way[way > 0.0].sum(), -way[way < 0.0].sum()
        return bool(min(forth, back) > max(_ONE_WAY * (forth + back), _MOTION))

    def thinned(self, factor: int) -> Self:
        """Return the record with every `factor`-th row, and the mean set-point between two."""
        if factor == 1:
            return self
        last = (len(self) - 1) // factor
        means = self.setpoints[1 : last * factor + 1].reshape(last, factor).mean(axis=1)
        return replace(
            self,
            times=self.times[::factor],
            interval=factor * self.interval,
            stretches=tuple(_thin(part, factor) for part in self.stretches),
            setpoints=np.concatenate([self.setpoints[:1], means]),
            measured=self.measured[::factor],
            sessions=tuple(one._replace(rows=_thin(one.rows, factor)) for one in self.sessions),
            clipped=self.clipped[::factor],
        )

    def rows_in(self, duration: float) -> int:
        """Return the rows of a duration [s]; half a row is none, whatever the interval's digits."""
        return math.ceil(duration / self.interval - 0.5 - 1e-6)

    @classmethod
    def of(cls, recording: Recording, axis: str, full_opening: float, name: str = "") -> Self:
        """Return the record of an axis.

        Args:
            recording: has the `NEEDED` quantities of the axis and a pressure.
            axis: its name.
            full_opening: spool position that a set-point of 1 stands for [m].
            name: of the recording.
        """
        _check_columns(recording, axis)
        times = recording[TIME.name]
        interval = _check_times(times)
        fields = recording.dtype.names or ()
        known = (*NEEDED, *PRESSURES)
        quantities = [quantity for quantity in known if f"{axis}.{quantity}" in fields]
        _check_values(recording, axis, quantities)
        has = np.array([signal in quantities for signal in SIGNALS])
        measured, noise = np.full((len(times), 3), np.nan), np.full(3, np.inf)
        for place in np.flatnonzero(has).tolist():
            measured[:, place] = recording[f"{axis}.{SIGNALS[place]}"]
            noise[place] = estimate_noise(measured[:, place], FLOORS[place])
        return cls(
            axis=axis,
            times=np.asarray(times, dtype=np.float64),
            interval=interval,
            stretches=_find_stretches(times, interval),
            full_opening=full_opening,
            setpoints=full_opening * recording[f"{axis}.spool_setpoint"],
            measured=measured,
            noise=noise,
            sessions=(Session(name, range(len(times)), has),),
        )


def join_records(records: Sequence[AxisRecord]) -> AxisRecord:
    """Return records of one axis as one, each with its own offsets of the pressure sensors.

    Raises:
        ConfigError: their rows are not equally far apart, or they are too short together.
    """
    first = records[0]
    span = sum(record.interval * sum(map(len, record.stretches)) for record in records)
    if span < _SHORTEST - 2.0 * first.interval * len(records):
        names = ", ".join(record.sessions[0].name for record in records)
        spans = "the recordings span together" if len(records) > 1 else "the recording spans"
        raise ConfigError(f"{names}: {spans} {span:.3g} s; {_SHORTEST:g} s or more are right")
    if len(records) == 1:
        return first
    for record in records[1:]:
        if abs(record.interval - first.interval) > _UNEVEN * first.interval:
            raise ConfigError(
                f"{first.sessions[0].name} has a row each {first.interval * 1e3:.4g} ms and "
                f"{record.sessions[0].name} each {record.interval * 1e3:.4g} ms; give recordings "
                "with one sampling interval"
            )
    starts = np.cumsum([0, *(len(record) for record in records)]).tolist()
    pairs = list(zip(starts, records, strict=False))
    return replace(
        first,
        times=np.concatenate([record.times for record in records]),
        interval=float(np.mean([record.interval for record in records])),
        stretches=tuple(_shift(rows, start) for start, one in pairs for rows in one.stretches),
        setpoints=np.concatenate([record.setpoints for record in records]),
        measured=np.concatenate([record.measured for record in records]),
        noise=_pool([record.noise for record in records]),
        sessions=tuple(
            session._replace(rows=_shift(session.rows, start))
            for start, record in pairs
            for session in record.sessions
        ),
        notes=tuple(
            f"{record.sessions[0].name}: {note}" for record in records for note in record.notes
        ),
        clipped=np.concatenate([record.clipped for record in records]),
    )


def _thin(rows: range, factor: int) -> range:
    return range(-(-rows.start // factor), (rows.stop - 1) // factor + 1)


def _shift(rows: range, by: int) -> range:
    return range(rows.start + by, rows.stop + by)


def _pool(noises: Sequence[Values]) -> Values:
    """Return the noise of each signal over the records that have it, infinite where none has."""
    known = np.isfinite(noises)
    squares = np.where(known, np.square(noises), 0.0).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(known.any(axis=0), np.sqrt(squares / known.sum(axis=0)), np.inf)


def estimate_noise(values: Values, floor: float) -> float:
    """Return the standard deviation of a signal's noise.

    Eighth differences leave little of what goes on smoothly from row to row, and of oscillations up
    to a third of the sampling rate. Stiff oil rings after each step of the valve, so the quietest
    tenth of the signal counts: of white noise, the power there is a known part of the mean.

    Args:
        values: of the signal.
        floor: at least this, and at least the rounding of the sensor's smallest step.
    """
    return max(quiet_noise(values), floor, _rounding(values))


def _rounding(values: Values) -> float:
    """Return the standard deviation of rounding to the smallest step between a signal's values.

    It counts only where nearly all steps are multiples of the smallest one: the steps of an axis
    that never rests are large, too.
    """
    steps = np.diff(np.unique(values))
    if not len(steps):
        return 0.0
    multiples = steps / steps.min()
    is_multiple = np.abs(multiples - np.rint(multiples)) < _MULTIPLE
    return float(steps.min()) / math.sqrt(12.0) if is_multiple.mean() > _NEARLY_ALL else 0.0


def quiet_noise(values: Values) -> float:
    """Return the standard deviation of noise in the quietest tenth of a signal."""
    powers = np.square(np.diff(values, n=_ORDER)) / math.comb(2 * _ORDER, _ORDER)
    blocks = len(powers) // _BLOCK
    if not blocks:
        return 0.0
    means = powers[: blocks * _BLOCK].reshape(blocks, _BLOCK).mean(axis=1)
    return float(np.sqrt(np.quantile(means, _QUIET) / _QUIET_POWER))


def _check_columns(recording: Recording, axis: str) -> None:
    """Refuse a recording that lacks a quantity.

    Raises:
        ConfigError: it does; the message says which, and which axes it has.
    """
    names = recording.dtype.names or ()
    lacking = [f"{axis}.{name}" for name in NEEDED if f"{axis}.{name}" not in names]
    if not any(f"{axis}.{name}" in names for name in PRESSURES):
        lacking.append(" and ".join(f"{axis}.{name}" for name in PRESSURES))
    if not lacking:
        return
    axes = {name.rpartition(".")[0] for name in names if name.endswith(".spool_setpoint")}
    has = f"it has {', '.join(sorted(axes))}" if axes else "it has no axis with a spool_setpoint"
    raise ConfigError(
        f"the recording lacks {', '.join(lacking)}, which identification needs; {has}"
    )


def _check_times(times: Values) -> float:
    """Return the interval between two rows [s].

    Raises:
        ConfigError: there are too few rows, too rare ones, or gaps.
    """
    if len(times) < 2 or not np.isfinite(times).all() or times[-1] - times[0] < _LEAST_STRETCH:
        span = times[-1] - times[0] if len(times) > 1 else 0.0
        raise ConfigError(
            f"the recording spans {span:g} s in {len(times)} rows; a stroke takes "
            f"{_LEAST_STRETCH:g} s and more"
        )
    steps = np.diff(times)
    interval = float(np.median(steps))
    back = np.flatnonzero(steps <= 0.0)
    if interval > 0.0 and len(back):
        row = back[0]
        raise ConfigError(
            f"the recording's time does not rise after {times[row]:g} s: the next row has "
            f"{times[row + 1]:g} s; give rows in the order of time"
        )
    if not 0.0 < interval <= _SLOWEST * (1.0 + _ROUNDED):
        raise ConfigError(
            f"the recording has a row each {interval * 1e3:g} ms; give {_SLOWEST * 1e3:g} ms "
            "or less"
        )
    # A time since 1970 is rounded to 0.24 us: of a row each 1 ms, the median is off by 0.01 %.
    return float(steps[np.abs(steps - interval) <= _UNEVEN * interval].mean())


def _find_stretches(times: Values, interval: float) -> tuple[range, ...]:
    """Return the rows between gaps, where these are long enough to serve.

    Raises:
        ConfigError: hardly any are.
    """
    steps = np.diff(times)
    gaps = np.flatnonzero(np.abs(steps - interval) > _UNEVEN * interval)
    stretches = _pieces(range(len(times)), gaps.tolist(), interval)
    span = interval * sum(map(len, stretches))
    if span < _HALF * (times[-1] - times[0] - steps[gaps].sum()):
        place = gaps[0]
        raise ConfigError(
            f"the recording has {len(gaps)} gaps in time, the first at {times[place]:g} s, of "
            f"{steps[place] * 1e3:g} ms; {span:.3g} s of it are even for {_LEAST_STRETCH:g} s and "
            "more"
        )
    return tuple(stretches)


def _pieces(part: range, rows: Sequence[int], interval: float) -> list[range]:
    """Return the pieces of a stretch that is cut behind some rows, where they are long enough."""
    edges = [part.start, *sorted(row + 1 for row in rows if row + 1 in part), part.stop]
    pieces = itertools.starmap(range, itertools.pairwise(edges))
    return [piece for piece in pieces if len(piece) * interval >= _LEAST_STRETCH]


def _check_values(recording: Recording, axis: str, quantities: Sequence[str]) -> None:
    """Refuse values that are no numbers, a sensor that is not connected, and an axis at rest.

    Raises:
        ConfigError: there is one.
    """
    for quantity in quantities:
        name = f"{axis}.{quantity}"
        values = recording[name]
        wrong = np.flatnonzero(~np.isfinite(values))
        if len(wrong):
            raise ConfigError(
                f"the recording's {name} is no number in {len(wrong)} rows, first at "
                f"{recording[TIME.name][wrong[0]]:g} s; give a part without them"
            )
        travel = float(np.ptp(values))
        if quantity != "position" and travel == 0.0:
            raise ConfigError(
                f"the recording's {name} is constant at {values[0]:g}; leave a column out that "
                "measures nothing"
            )
        if quantity == "position" and travel < _MOTION:
            raise ConfigError(
                f"{axis} moves by {travel * 1e3:.3g} mm in this recording; {_MOTION * 1e3:g} mm or "
                "more are needed, in both directions"
            )
