"""The loss of a residual: its square, but growing only linearly beyond a knee.

Pseudo-Huber: cost(r) = k² (sqrt(1 + (r / k)²) - 1), r² / 2 for small residuals, k |r| for large.
"""

import numpy as np
import numpy.typing as npt

Values = npt.NDArray[np.float64]

KNEE = 3.0
"""Of the fine fit, in multiples of the noise: it costs 1 % of the efficiency on white noise."""


def cost_of(residuals: Values, knee: float = KNEE) -> Values:
    """Return the cost of each residual."""
    squares = np.square(residuals)
    # The same as knee² (sqrt(1 + (r / knee)²) - 1), exact for small r and an infinite knee.
    return np.asarray(squares / (1.0 + np.sqrt(1.0 + squares / knee**2)))


def pull_of(residuals: Values, knee: float = KNEE) -> Values:
    """Return the slope of each cost over its residual: the weight in the gradient."""
    return np.asarray(1.0 / np.sqrt(1.0 + np.square(residuals) / knee**2))


def bend_of(residuals: Values, knee: float = KNEE) -> Values:
    """Return the second derivative of each cost: the weight in the information."""
    return np.asarray(pull_of(residuals, knee) ** 3)
