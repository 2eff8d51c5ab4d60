"""Candidates: steps, ramps, chirps, sums of sines, holding, each from rest to rest."""

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.design.bounds import Bounds
from hil_bench.abilities.identification.design.twin import Twin

Values = npt.NDArray[np.float64]

_LENGTH = 3.2  # [s] of a candidate, its way back apart
_LEVELS = (0.05, 0.15, 0.4, 1.0)  # of the way from the dead-zone to the full opening
_SHARE = 0.6  # of the room that a motion one way takes by its speed
_SHORTEST = 0.04  # [s] of one motion
_MEASURED = 0.3  # [s], in which the speed at an opening is measured
_RETURN = 0.15  # of the levels: at that opening the piston goes back
_AWAY = 1e-3  # [m] from the start: below, nothing goes back
_SINES = 6
_QUIET = 0.2  # [s] with the valve closed at the end
_CREEP = 2e-3  # [m/s] below which a way takes too long
_CLOSE = 0.9  # of the room, behind which the piston goes to an end stop slowly
_CAREFUL = 0.9  # of the speed at which it may touch the stop
_SURE = (1.15, 0.2)  # times the time to the stop by the model, and so much more [s]


class Manoeuvre(NamedTuple):
    """A candidate.

    Attributes:
        name: in words.
        setpoints: of each row, as shares of the full opening, shape (rows,).
    """

    name: str
    setpoints: Values


class Pace(NamedTuple):
    """The speed of the piston at an opening.

    Attributes:
        opening: as a share of the full opening.
        out: speed with the opening positive [m/s].
        back: with it negative [m/s].
    """

    opening: float
    out: float
    back: float

    @property
    def faster(self) -> float:
        """The larger speed [m/s]."""
        return max(self.out, self.back)


def measure_paces(twin: Twin, bounds: Bounds) -> list[Pace]:
    """Return the speeds at the openings of the candidates, those that the bounds allow."""
    paces = []
    closed = dead_share(twin)
    rows = round(_MEASURED / twin.interval)
    for level in _LEVELS:
        opening = closed + level * (1.0 - closed)
        out, back = (
            abs(float(twin.run(np.full(rows, sign * opening), bounds.middle)[-1, 1]))
            for sign in (1.0, -1.0)
        )
        pace = Pace(opening, out, back)
        if 0.0 < pace.faster < bounds.speed:
            paces.append(pace)
    return paces


def dead_share(twin: Twin) -> float:
    """Return the overlap of the spool as a share of the full opening, of the larger side."""
    negative = twin.options.beta_negative
    beta = max(twin.parameters.beta, negative if negative is not None else 0.0)
    return min(beta / twin.full_opening, 0.9)


def draw_manoeuvres(twin: Twin, bounds: Bounds, paces: list[Pace]) -> Iterator[Manoeuvre]:
    """Yield the candidates; each by itself begins and ends at rest.

    Args:
        twin: of the machine.
        bounds: of the motion.
        paces: as `measure_paces` returns them.
    """
    grid = _Grid(twin.interval)
    for pace in paces:
        span = _SHARE * bounds.room / pace.faster  # [s] of motion one way
        u, name = pace.opening, f"{100.0 * pace.opening:.0f} %"
        on = min(0.25, span)
        if on >= _SHORTEST:
            yield Manoeuvre(f"steps of {name} both ways", grid.steps(u, on))
        # A ramp goes on average at half of its highest speed.
        quarter = min(0.25 * _LENGTH, span)
        if quarter >= _SHORTEST:
            yield Manoeuvre(f"slow ramps to {name} both ways", grid.ramps(u, quarter))
        for low, high in ((1.0, 20.0), (5.0, 100.0)):
            # A sine takes the piston by its highest speed / (pi f) one way, at the most.
            least = max(low, 1.0 / (np.pi * span))
            if least < 0.5 * high and high < 0.4 / twin.interval:
                band = f"{least:.3g} to {high:g} Hz"
                yield Manoeuvre(f"chirp of {name}, {band}", grid.chirp(u, least, high))
        least = max(1.0, 1.0 / (np.pi * span))
        if least < 20.0:
            yield Manoeuvre(f"sum of {_SINES} sines of {name}", grid.sines(u, least))
        if on >= 0.1:
            yield Manoeuvre(f"random steps up to {name}", grid.random(dead_share(twin), u))
        if on >= _SHORTEST:
            yield Manoeuvre(f"{name} for {on:.2g} s, then closed, both ways", grid.holds(u, on))
        if span >= 0.25:
            yield Manoeuvre(
                f"chirp of a tenth about {name} both ways", grid.biased(u, min(span, 1.2))
            )


def draw_contacts(twin: Twin, bounds: Bounds, paces: list[Pace]) -> Iterator[Manoeuvre]:
    """Yield motions to each end stop that may be touched, slowly on the last part of the way.

    The piston stands at the stop while the valve is open, closed, open again and closed: what its
    pressures do then tells compliance, delay and leakage.

    Args:
        twin: of the machine.
        bounds: of the motion.
        paces: as `measure_paces` returns them.
    """
    grid, back = _Grid(twin.interval), pace_of_return(paces)
    for stop in bounds.stops:
        side = 1.0 if stop > bounds.middle else -1.0
        levels = [_gait(twin, bounds, pace.opening, side) for pace in paces]
        levels += [_gait(twin, bounds, opening, side) for opening in _careful(twin, paces)]
        usable = [gait for gait in levels if gait.mean > _CREEP]
        slow = [gait for gait in usable if gait.peak < _CAREFUL * bounds.contact_speed]
        if not slow:
            continue
        near = max(slow, key=lambda gait: gait.mean)
        # Fast motion would end nobody knows where, since the machine is not known yet.
        allowed = [gait for gait in usable if gait.opening <= back.opening]
        far = max((near, *allowed), key=lambda gait: gait.mean)
        way = _CLOSE * bounds.room
        times, more = _SURE
        pattern = [
            (far.opening, way / far.mean),
            (near.opening, times * (abs(stop - bounds.middle) - way) / near.mean + more),
            (0.0, 0.3),
            (near.opening, 0.1),
            (0.0, 0.2),
        ]
        yield Manoeuvre(
            f"to the end stop at {1e3 * stop:+.0f} mm with {1e3 * near.mean:.0f} mm/s",
            np.concatenate([grid.hold(side * value, duration) for value, duration in pattern]),
        )


class _Gait(NamedTuple):
    """The motion of the piston at an opening to one side: a slow one sticks and slips.

    Attributes:
        opening: as a share of the full opening.
        mean: speed [m/s].
        peak: highest speed [m/s].
    """

    opening: float
    mean: float
    peak: float


def _gait(twin: Twin, bounds: Bounds, opening: float, side: float) -> _Gait:
    rows = round(_MEASURED / twin.interval)
    states = twin.run(np.full(2 * rows, side * opening), bounds.middle)
    mean = side * (states[-1, 0] - states[rows, 0]) / ((rows - 1) * twin.interval)
    return _Gait(opening, float(mean), float((side * states[:, 1]).max()))


def _careful(twin: Twin, paces: list[Pace]) -> list[float]:
    """Return openings between those of the candidates."""
    openings = [dead_share(twin), *(pace.opening for pace in paces)]
    return [0.5 * sum(pair) for pair in itertools.pairwise(openings)]


def come_back(twin: Twin, bounds: Bounds, setpoints: Values, pace: Pace) -> tuple[Values, Values]:
    """Return set-points that end where they began, and the states of their run.

    Args:
        twin: of the machine.
        bounds: of the motion; it begins in their middle.
        setpoints: of each row, shape (rows,).
        pace: of the way back.
    """
    states = twin.run(setpoints, bounds.middle)
    away = float(states[-1, 0]) - bounds.middle
    speed = pace.back if away > 0.0 else pace.out
    if abs(away) < _AWAY or not speed:
        return setpoints, states
    rows = round(min(abs(away) / speed, _LENGTH) / twin.interval)
    quiet = np.zeros(round(_QUIET / twin.interval))
    way = np.full(rows, -np.sign(away) * pace.opening)
    whole = np.concatenate([setpoints, way, quiet])
    return whole, twin.run(whole, bounds.middle)


def pace_of_return(paces: list[Pace]) -> Pace:
    """Return the pace at which the piston goes back."""
    return paces[min(len(paces) - 1, _LEVELS.index(_RETURN))]


class _Grid(NamedTuple):
    """Set-points on the rows of a recording.

    Attributes:
        interval: between two rows [s].
    """

    interval: float

    def hold(self, value: float, duration: float) -> Values:
        return np.full(round(duration / self.interval), value)

    def repeat(self, parts: Values) -> Values:
        """Return a pattern as often as the length of a candidate has room for it."""
        count = max(1, round(_LENGTH / (len(parts) * self.interval)))
        return np.concatenate([*[parts] * count, self.hold(0.0, _QUIET)])

    def steps(self, u: float, on: float) -> Values:
        pattern = [
            self.hold(value, duration)
            for sign in (1.0, -1.0)
            for value, duration in ((sign * u, on), (0.0, 0.15))
        ]
        return self.repeat(np.concatenate(pattern))

    def ramps(self, u: float, quarter: float) -> Values:
        rise = np.linspace(0.0, u, max(2, round(quarter / self.interval)))
        up = np.concatenate([rise, rise[::-1]])
        return self.repeat(np.concatenate([up, -up]))

    def holds(self, u: float, on: float) -> Values:
        parts = []
        for sign in (1.0, -1.0):
            parts += [self.hold(sign * u, on), self.hold(0.0, 0.5 * _LENGTH - on)]
        return np.concatenate(parts)

    def random(self, low: float, u: float) -> Values:
        source = np.random.default_rng(1)
        count = round(0.5 * _LENGTH / 0.1)
        sizes = source.uniform(low, u, count)
        # Each size goes both ways, so that the piston stays about where it is.
        both = np.column_stack([sizes, -sizes]).reshape(-1)
        return np.concatenate([*(self.hold(size, 0.1) for size in both), self.hold(0.0, _QUIET)])

    def chirp(self, u: float, low: float, high: float) -> Values:
        times = self.interval * np.arange(round(_LENGTH / self.interval))
        phase = 2.0 * np.pi * (low + 0.5 * (high - low) / _LENGTH * times) * times
        # It begins at the crest, and so swings about the start.
        return np.concatenate([u * np.cos(phase), self.hold(0.0, _QUIET)])

    def sines(self, u: float, low: float) -> Values:
        """Sines with the phases of Schroeder 1970, which keep their sum's crest low."""
        times = self.interval * np.arange(round(_LENGTH / self.interval))
        frequencies = low * (40.0 / low) ** (np.arange(_SINES) / (_SINES - 1))
        phases = -np.pi * np.arange(_SINES) * (np.arange(_SINES) + 1) / _SINES
        total = np.cos(2.0 * np.pi * np.outer(times, frequencies) + phases).sum(axis=1)
        return np.concatenate([u * total / np.abs(total).max(), self.hold(0.0, _QUIET)])

    def biased(self, u: float, span: float) -> Values:
        times = self.interval * np.arange(round(span / self.interval))
        sweep = 0.1 * u * np.sin(2.0 * np.pi * (2.0 + 0.5 * 60.0 / span * times) * times)
        parts = [np.concatenate([sign * u + sweep, self.hold(0.0, 0.1)]) for sign in (1.0, -1.0)]
        return self.repeat(np.concatenate(parts))
