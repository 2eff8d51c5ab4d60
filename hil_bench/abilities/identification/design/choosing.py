"""The choice of successive manoeuvres that leave the least uncertainty.

The measure is A-optimality: the sum of the parameters' variances, each in multiples of the
deviation up to which a parameter counts as identified. The parameter that is known worst has the
largest share of it. The determinant of the covariance (D-optimality) would count halving any
deviation the same, and so prefer runs that tell the well known parameters still better.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.design.bounds import Bounds
from hil_bench.abilities.identification.design.foresight import TOLD, Foresight, invert
from hil_bench.abilities.identification.design.manoeuvres import (
    Manoeuvre,
    Pace,
    come_back,
    draw_contacts,
    draw_manoeuvres,
    measure_paces,
    pace_of_return,
)
from hil_bench.errors import ConfigError

Values = npt.NDArray[np.float64]

_START = 0.3  # [s] with the valve closed before the first manoeuvre
_LITTLE = 0.02  # of the uncertainty: a manoeuvre that takes less away is not worth its time
_ALIKE = 0.02  # of the best: as good as that
_TOLD = 1.0  # multiple of the limit up to which a parameter counts as identified


class Ranked(NamedTuple):
    """A candidate and what it would tell.

    Attributes:
        name: of the manoeuvre.
        duration: of it [s].
        left: root mean square uncertainty that it leaves, as a share of that without it.
        best_for: the parameters that no other candidate tells better.
    """

    name: str
    duration: float
    left: float
    best_for: tuple[str, ...]


class Outlook(NamedTuple):
    """A parameter before and after.

    Attributes:
        name: its key.
        value: as known, in the unit of the key.
        before: standard deviation by what is known.
        after: standard deviation after the run.
        is_told_before: whether it counts as identified.
        is_told_after: likewise, after the run.
    """

    name: str
    value: float
    before: float
    after: float
    is_told_before: bool
    is_told_after: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Design:
    """A run of manoeuvres.

    Attributes:
        axis: that it is for.
        interval: between two set-points [s].
        names: of the manoeuvres, in order, each with the time at which it begins [s].
        setpoints: of the run, as shares of the full opening, shape (rows,).
        states: that are expected, shape (rows, 4) [m, m/s, Pa, Pa].
        start: where the piston begins [m].
        ranking: all candidates, the best first.
        refused: how many candidates would leave a bound, by bound.
        outlooks: one a parameter.
    """

    axis: str
    interval: float
    names: tuple[tuple[float, str], ...]
    setpoints: Values
    states: Values
    start: float
    ranking: tuple[Ranked, ...]
    refused: dict[str, int]
    outlooks: tuple[Outlook, ...]

    @property
    def duration(self) -> float:
        """Of the run [s]."""
        return len(self.setpoints) * self.interval


class _Candidate(NamedTuple):
    name: str
    setpoints: Values
    information: Values

    def duration(self, interval: float) -> float:
        return len(self.setpoints) * interval


@dataclass(frozen=True, slots=True)
class Designer:
    """Chooses manoeuvres.

    Attributes:
        foresight: what a run would tell.
        bounds: of the motion.
        aside: parameters that are sought with the others, but do not choose between manoeuvres.
        report: is called after each candidate.
    """

    foresight: Foresight
    bounds: Bounds
    aside: tuple[str, ...] = ()
    report: Callable[[str], None] = lambda _: None

    def design(self, duration: float) -> Design:
        """Return the run that leaves least uncertain.

        Args:
            duration: that it may take [s].

        Raises:
            ConfigError: no manoeuvre stays within the bounds.
        """
        twin = self.foresight.twin
        candidates, refused = self._candidates()
        if not candidates:
            most = max(refused, key=lambda bound: refused[bound], default="position")
            raise ConfigError(
                f"--design: each of the {sum(refused.values())} manoeuvres would leave the limits, "
                f"mostly that of {most}; give wider [limits]"
            )
        prior = self.foresight.prior()
        within = self._within(prior, candidates)
        ranking = self._rank(prior, candidates, within)
        chosen = self._choose(prior, candidates, within, duration - 2.0 * _START)
        while True:
            names, setpoints = self._join(chosen)
            states = twin.run(setpoints, self.bounds.middle)
            # What each manoeuvre drifts adds up.
            if len(chosen) == 1 or not self.bounds.leaves(states):
                break
            chosen.pop()
        information = self.foresight.information(setpoints, states)
        return Design(
            axis=twin.axis,
            interval=twin.interval,
            names=names,
            setpoints=setpoints,
            states=states,
            start=self.bounds.middle,
            ranking=tuple(ranking),
            refused=refused,
            outlooks=tuple(self._outlooks(prior, information)),
        )

    def _candidates(self) -> tuple[list[_Candidate], dict[str, int]]:
        """Return the candidates within the bounds, and how many left each bound."""
        twin, refused = self.foresight.twin, dict[str, int]()
        paces = measure_paces(twin, self.bounds)
        if not paces:
            return [], {"speed": 1}
        candidates = []
        for manoeuvre in (
            *draw_manoeuvres(twin, self.bounds, paces),
            *draw_contacts(twin, self.bounds, paces),
        ):
            candidate = self._look(manoeuvre, pace_of_return(paces))
            if isinstance(candidate, str):
                refused[candidate] = refused.get(candidate, 0) + 1
            else:
                candidates.append(candidate)
            self.report(manoeuvre.name)
        return candidates, refused

    def _look(self, manoeuvre: Manoeuvre, pace: Pace) -> "_Candidate | str":
        """Return a candidate with its information, or the bound that it leaves."""
        twin = self.foresight.twin
        setpoints, states = come_back(twin, self.bounds, manoeuvre.setpoints, pace)
        left = self.bounds.leaves(states)
        if left:
            return left
        information = self.foresight.information(setpoints, states)
        return _Candidate(manoeuvre.name, setpoints, information)

    def _variances(self, prior: Values, information: Values) -> Values:
        """Return the variances of the free variables, as multiples of the limits squared."""
        total = prior + self.foresight.reduce(information)
        return np.asarray(np.diag(invert(total)) / TOLD**2)

    def _within(self, prior: Values, candidates: Sequence[_Candidate]) -> npt.NDArray[np.bool_]:
        """Mark the parameters that count: those that some candidate makes identifiable."""
        nothing = np.zeros_like(candidates[0].information)
        before = self._variances(prior, nothing)
        whole = sum((one.information for one in candidates), nothing)
        after = self._variances(prior, whole)
        counts = (after < _TOLD) | (after < 0.25 * before)
        # The position of a stop must be known to use what happens there, but nobody asks for it.
        counts &= np.array([name not in self.aside for name in self.foresight.names])
        return np.asarray(counts if counts.any() else np.ones_like(counts))

    def _rank(
        self, prior: Values, candidates: Sequence[_Candidate], within: npt.NDArray[np.bool_]
    ) -> list[Ranked]:
        interval, names = self.foresight.twin.interval, self.foresight.names
        before = self._variances(prior, np.zeros_like(candidates[0].information))
        afters = np.array([self._variances(prior, one.information) for one in candidates])
        is_best = (afters <= afters.min(axis=0) * (1.0 + _ALIKE)) & within
        ranking = [
            Ranked(
                one.name,
                one.duration(interval),
                float(np.sqrt(after[within].sum() / before[within].sum())),
                tuple(name for name, best in zip(names, bests, strict=True) if best),
            )
            for one, after, bests in zip(candidates, afters, is_best, strict=True)
        ]
        return sorted(ranking, key=lambda each: np.log(each.left) / each.duration)

    def _choose(
        self,
        prior: Values,
        candidates: Sequence[_Candidate],
        within: npt.NDArray[np.bool_],
        room: float,
    ) -> list[_Candidate]:
        """Return manoeuvres, each the one that takes most uncertainty away in a second.

        Raises:
            ConfigError: none is so short.
        """
        interval = self.foresight.twin.interval
        chosen: list[_Candidate] = []
        total = np.zeros_like(candidates[0].information)
        before = self._variances(prior, total)[within].sum()
        while True:
            fitting = [one for one in candidates if one.duration(interval) <= room]
            if not fitting:
                break
            afters = [self._variances(prior, total + each.information) for each in fitting]
            gains = [
                float(np.log(before / after[within].sum())) / each.duration(interval)
                for each, after in zip(fitting, afters, strict=True)
            ]
            place = int(np.argmax(gains))
            best, after = fitting[place], float(afters[place][within].sum())
            if chosen and after > (1.0 - _LITTLE) ** 2 * before:
                break
            chosen.append(best)
            total, before = total + best.information, after
            room -= best.duration(interval)
        if not chosen:
            shortest = min(one.duration(interval) for one in candidates)
            least = shortest + 2.0 * _START
            raise ConfigError(f"--duration: is too short; the shortest run takes {least:.1f} s")
        return chosen

    def _join(self, chosen: Sequence[_Candidate]) -> tuple[tuple[tuple[float, str], ...], Values]:
        """Return the names with their times, and the set-points."""
        interval = self.foresight.twin.interval
        rest = np.zeros(round(_START / interval))
        parts, names = [rest], []
        for one in chosen:
            names.append((sum(map(len, parts)) * interval, one.name))
            parts.append(one.setpoints)
        return tuple(names), np.concatenate([*parts, rest])

    def _outlooks(self, prior: Values, information: Values) -> list[Outlook]:
        foresight = self.foresight
        unknowns = foresight.unknowns[: len(foresight.names)]
        slopes = np.array([abs(one.slope(one.start)) for one in unknowns])
        after = prior + foresight.reduce(information)
        was_known, will_be = (slopes * np.sqrt(np.diag(invert(each))) for each in (prior, after))
        tolds = [
            self._variances(prior, each) <= _TOLD
            for each in (np.zeros_like(information), information)
        ]
        return [
            Outlook(
                one.name, one.value(one.start), float(before), float(after), bool(was), bool(will)
            )
            for one, before, after, was, will in zip(
                unknowns, was_known, will_be, *tolds, strict=True
            )
        ]
