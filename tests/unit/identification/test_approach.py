"""What is said of starts that ended elsewhere."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt
from support.measured_lines import Lines, measure, polish_of

from hil_bench.abilities.identification.approach import Rival, find_rivals
from hil_bench.abilities.identification.fit import Fit
from hil_bench.abilities.identification.unknowns import Unknowns
from hil_bench.plants.hydraulic_cylinder.model import paper_parameters

UNKNOWNS = Unknowns(paper_parameters(), ("E", "m"))  # and two offsets


def fit_at(variables: npt.NDArray[np.float64], residual: float) -> Fit:
    """Return a fit that has ended at these variables, with deviations of 0.01."""
    polish = polish_of(Lines(measure(2.0, noise=1.0)))
    optimum = replace(polish.run(np.zeros(2), lambda: None, most=0), variables=variables)
    covariance = 1e-4 * np.eye(4)
    return Fit(optimum, covariance, covariance, np.full(3, residual), 0.0, True, polish)


def test_another_start_three_deviations_away_is_a_rival() -> None:
    fit = fit_at(np.zeros(4), 1.0)
    near, far = fit_at(np.full(4, 0.029), 1.0), fit_at(np.array([0.0, 0.05, 0.0, 0.0]), 1.2)

    (rival,) = find_rivals(UNKNOWNS, fit, [near, far])

    assert rival == Rival(residual=rival.residual, apart={"m": rival.apart["m"]})
    assert np.isclose(rival.apart["m"], 5.0)
    assert np.isclose(rival.residual, 1.2)
