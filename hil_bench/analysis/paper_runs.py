"""The simulations behind the paper's figs. 5 and 6, and those that tell what causes what.

Table I, forward Euler at 1e-4 s, tanh(400 v) for the sign, as section IV-B says. What it does not
say is decided here: the chirp is linear and lasts a minute, a run starts from rest at mid-stroke.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from hil_bench.analysis.figures import TrajectoryPair
from hil_bench.analysis.frequency_response import Chirp, ChirpRun, measure_frequency_response
from hil_bench.analysis.simulated_studies import measure_both_models, simulate_both_models
from hil_bench.analysis.simulation import Setup, without_input_nonlinearities
from hil_bench.plant import Model, PlantParameters, paper_parameters

CHIRP_DURATION = 60.0
"""Length of the chirp [s]; the paper does not give it."""

SMOOTHING = 1.0 / 12.0
"""Width of the spectra's moving average [octave]; the paper says "smoothed"."""

RESONANCE_BAND = (20.0, 200.0)
"""Where the resonance is looked for [Hz]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperRuns:
    """What was simulated.

    Attributes:
        parameters: Table I.
        chirps: full-order at alpha and 0.3 alpha, then reduced at both (fig. 5).
        frozen: full-order at alpha with volumes that do not change.
        frictionless: reduced at 0.3 alpha with viscous friction alone.
        trajectories: both models at 0.4 mm and at 1 mm (fig. 6).
        double_rod: both models at 1 mm with two equal areas and volumes that do not change.
    """

    parameters: PlantParameters
    chirps: Sequence[ChirpRun]
    frozen: ChirpRun
    frictionless: ChirpRun
    trajectories: Sequence[TrajectoryPair]
    double_rod: TrajectoryPair


def run_paper(*, chirp_duration: float = CHIRP_DURATION) -> PaperRuns:
    """Return all runs.

    Args:
        chirp_duration: length of each chirp [s].
    """
    table_1 = paper_parameters()
    setup = Setup(parameters=table_1)
    high, low = (
        Chirp(amplitude=share * table_1.alpha, duration=chirp_duration) for share in (1.0, 0.3)
    )
    return PaperRuns(
        parameters=table_1,
        chirps=measure_both_models(setup, (high, low), with_valve=False, smoothing=SMOOTHING),
        frozen=_measure(replace(setup, parameters=with_constant_volumes(table_1)), high),
        frictionless=_measure(
            Setup(parameters=replace(table_1, F_c=0.0, F_s=0.0), model=Model.REDUCED), low
        ),
        trajectories=simulate_both_models(setup, (4e-4, 1e-3)),
        double_rod=simulate_both_models(
            replace(setup, parameters=with_constant_volumes(as_double_rod(table_1))), (1e-3,)
        )[0],
    )


def with_constant_volumes(parameters: PlantParameters) -> PlantParameters:
    """Return a cylinder whose volumes do not change: eqs. (10), (11) saturate at once."""
    return replace(parameters, h=1e-9)


def as_double_rod(parameters: PlantParameters) -> PlantParameters:
    """Return the cylinder that the reduced model averages to: equal areas, equal volumes."""
    area, volume = parameters.mean_area, 0.5 * parameters.total_volume
    return replace(parameters, A_A=area, A_B=area, V_A0=volume, V_B0=volume)


def _measure(setup: Setup, chirp: Chirp) -> ChirpRun:
    return measure_frequency_response(
        without_input_nonlinearities(setup, chirp.amplitude), chirp, smoothing=SMOOTHING
    )
