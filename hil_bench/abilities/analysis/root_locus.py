"""Root locus of position control: the poles of the closed loop around k G(s) / s, over k.

Ruderman 2017, section IV-A and fig. 2.
"""

import math
from dataclasses import dataclass
from itertools import permutations

import numpy as np
import numpy.typing as npt

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import PlantParameters

Polynomial = npt.NDArray[np.float64]
"""Coefficients, the highest power first."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RootLocus:
    """The closed loop's poles over the feedback gain.

    Attributes:
        gains: k [m²/s], shape (n,), rising from 0.
        poles: of the closed loop [rad/s], shape (n, order); a column follows one branch.
        open_loop_poles: where the branches start [rad/s].
        critical_gain: k at which the closed loop becomes unstable [m²/s].
        critical_frequency: of the oscillation there [rad/s].
    """

    gains: npt.NDArray[np.float64]
    poles: npt.NDArray[np.complex128]
    open_loop_poles: npt.NDArray[np.complex128]
    critical_gain: float
    critical_frequency: float


def root_locus(
    parameters: PlantParameters,
    *,
    gains: npt.ArrayLike | None = None,
    with_spool: bool = False,
) -> RootLocus:
    """Return the poles of 1 + k G(s) / s = 0 with G(s) of eq. (18), and the critical gain.

    Args:
        parameters: of the plant.
        gains: k [m²/s]; None for 0 to three times the critical gain.
        with_spool: whether the spool of eq. (1) stands in the loop too.

    Raises:
        ParameterError: a gain is negative or not finite, or they do not rise.
    """
    denominator = _open_loop(parameters, with_spool=with_spool)
    critical_gain, critical_frequency = _stability_limit(denominator)
    chosen = _spread(critical_gain) if gains is None else np.asarray(gains, dtype=np.float64)
    if chosen.ndim != 1 or not (np.isfinite(chosen).all() and (chosen >= 0.0).all()):
        raise ParameterError("gains: must be finite and 0 or greater, in a row")
    if (np.diff(chosen) <= 0.0).any():
        raise ParameterError("gains: must rise, so that each branch can be followed")
    return RootLocus(
        gains=chosen,
        poles=_branches(denominator, chosen),
        open_loop_poles=np.roots(denominator).astype(np.complex128),
        critical_gain=critical_gain,
        critical_frequency=critical_frequency,
    )


def _open_loop(parameters: PlantParameters, *, with_spool: bool) -> Polynomial:
    """Return the denominator of G(s) / s over a numerator of 1."""
    omega, omega_0 = parameters.omega_c, parameters.omega_0
    cylinder = np.array([1.0 / omega**2, 2.0 * parameters.zeta / omega, 1.0, 0.0])
    denominator: Polynomial = parameters.mean_area * cylinder
    if with_spool:
        spool = [1.0 / omega_0**2, 2.0 * parameters.xi / omega_0, 1.0]
        denominator = np.asarray(np.polymul(denominator, spool), dtype=np.float64)
    return denominator


def _stability_limit(denominator: Polynomial) -> tuple[float, float]:
    """Return the smallest positive gain with a pole on the imaginary axis, and where it lies.

    At s = j w, D(s) + k = 0 splits into its even powers of s, a polynomial in w² that gives -k,
    and its odd ones, which must vanish on their own.
    """
    order = len(denominator) - 1
    signs = np.array([1.0, 1.0, -1.0, -1.0])[np.arange(order, -1, -1) % 4]
    signed = denominator * signs
    odd = signed[(order - 1) % 2 :: 2]
    even = signed[order % 2 :: 2]
    crossings = []
    for square in np.roots(odd):
        gain = -float(np.polyval(even, square.real))
        if abs(square.imag) < 1e-9 * abs(square) and square.real > 0.0 and gain > 0.0:
            crossings.append((gain, math.sqrt(square.real)))
    return min(crossings, default=(math.inf, math.nan))


def _spread(critical_gain: float) -> npt.NDArray[np.float64]:
    """Return gains with more of them where the branches leave the open loop's poles."""
    largest = 3.0 * critical_gain if math.isfinite(critical_gain) else 1.0
    gains: npt.NDArray[np.float64] = largest * np.linspace(0.0, 1.0, 601) ** 2
    return gains


def _branches(
    denominator: Polynomial, gains: npt.NDArray[np.float64]
) -> npt.NDArray[np.complex128]:
    """Return the roots for each gain, each column next to where it was at the gain before."""
    constant = np.zeros_like(denominator)
    constant[-1] = 1.0
    orders = np.array(list(permutations(range(len(denominator) - 1))))
    rows: list[npt.NDArray[np.complex128]] = []
    for gain in gains:
        roots = np.roots(denominator + gain * constant).astype(np.complex128)
        before = rows[-1] if rows else np.sort_complex(roots)
        nearest = np.abs(roots[orders] - before).sum(axis=1).argmin()
        rows.append(roots[orders[nearest]])
    return np.array(rows)
