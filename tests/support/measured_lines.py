"""Lines measured with noise: a fit in closed form that a polish takes for pieces of a record."""

from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.polish import Polish

Values = npt.NDArray[np.float64]

PLACES = np.linspace(-1.0, 1.0, 30)
BASIS = np.column_stack([np.ones_like(PLACES), PLACES**2, PLACES**3, PLACES**4])


@dataclass(frozen=True)
class Slope:
    """The logarithm of a slope, and a variable that does nothing."""

    start: Values = field(default_factory=lambda: np.zeros(2))
    spreads: Values = field(default_factory=lambda: np.array([1e3, 1.0]))
    steps: Values = field(default_factory=lambda: np.array([2e-3, 2e-3]))
    bounds: tuple[Values, Values] = field(default_factory=lambda: (np.full(2, -9.0), np.full(2, 9)))

    def guess(self, variables: Values) -> Values:
        return variables


@dataclass
class Lines:
    """Pieces exp(v) x + own polynomial, measured with noise; jumps where v passes `jump_at`.

    The first line has the teeth of a saw, `saw` high: nearly everywhere they show a slope by v that
    is not there.
    """

    measured: Values
    jump: float = 0.0
    jump_at: float = 0.0
    saw: float = 0.0
    tooth: float = 1.0
    spreads: Values = field(init=False)
    states: Values = field(init=False)
    steps: Values = field(init=False)

    def __post_init__(self) -> None:
        self.states = np.zeros((len(self.measured), 4))
        self.steps = np.full_like(self.states, 1e-3)
        self.spreads = np.full_like(self.states, 100.0)

    @property
    def _is_first(self) -> Values:
        return np.asarray(np.arange(len(self.measured)) == 0, dtype=np.float64)

    def raw(self, guesses: list[Values], states: list[Values]) -> Values:
        """Return the residuals, shape (guesses, pieces, values)."""
        return np.array(
            [
                np.exp(guess[0]) * PLACES
                + own @ BASIS.T
                - self.measured
                + self.jump * (guess[0] > self.jump_at) * np.sign(PLACES)
                + np.outer(self._is_first, self.saw * (guess[0] / self.tooth % 1.0) * PLACES)
                for guess, own in zip(guesses, states, strict=True)
            ]
        )

    def anchor(self, guess: Values) -> Values:
        """Return the residuals from `states`; the lines have no solver whose steps are cut."""
        return np.asarray(self.raw([guess], [self.states])[0])

    def beside(self, guesses: list[Values], states: list[Values]) -> Values:
        """Return what `raw` does."""
        return self.raw(guesses, states)

    def shorten(self, sizes: Values) -> None:
        self.steps = np.minimum(1e-3, 0.03 / np.maximum(sizes, 1e-9))

    def part(self, which: npt.NDArray[np.int64]) -> "Lines":
        part = replace(self, measured=self.measured[which])
        part.states = self.states[which]
        return part

    def copy(self) -> "Lines":
        return self.part(np.arange(len(self.measured)))


def measure(slope: float, noise: float, pieces: int = 20) -> Values:
    """Return lines of a slope, each with a polynomial of its own, and noise from a fixed seed."""
    source = np.random.default_rng(21)
    own = source.standard_normal((pieces, 4)) @ BASIS.T
    return slope * PLACES + own + noise * source.standard_normal((pieces, len(PLACES)))


def polish_of(lines: Lines, held: int | None = None) -> Polish:
    """Return the polish of lines."""
    return Polish(cast("Any", Slope()), cast("Any", lines), held=held)
