"""The simulations behind the paper's figs. 5 and 6, and those that tell what causes what.

Table I, forward Euler at 1e-4 s, tanh(400 v) for the sign, as section IV-B says. What it does not
say is decided here: the chirp is linear and lasts a minute, a run starts from rest at mid-stroke.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from hil_bench.abilities.analysis.figures import TrajectoryPair
from hil_bench.abilities.analysis.frequency_response import (
    SMOOTHING,
    Chirp,
    ChirpRun,
    measure_frequency_response,
)
from hil_bench.abilities.analysis.simulated_studies import measure_both_models, simulate_both_models
from hil_bench.abilities.analysis.simulation import Setup, without_input_nonlinearities
from hil_bench.abilities.analysis.trajectories import state_trajectory
from hil_bench.outside.recording.channels import Recording
from hil_bench.plants.hydraulic_cylinder.model import (
    Model,
    PlantParameters,
    PlantState,
    paper_parameters,
)

CHIRP_DURATION = 60.0
"""Length of the chirp [s]; the paper does not give it."""

RESONANCE_BAND = (20.0, 200.0)
"""Where the resonance is looked for [Hz]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperRuns:
    """The simulations of the paper's figures.

    Attributes:
        parameters: Table I.
        chirps: full-order at alpha and 0.3 alpha, then reduced at both (fig. 5).
        frozen: full-order at alpha with volumes that do not change.
        frictionless: reduced at 0.3 alpha with viscous friction alone.
        trajectories: both models at 0.4 mm and at 1 mm (fig. 6).
        double_rod: both models at 1 mm with two equal areas and volumes that do not change.
        empty_with_sign: full-order at 0.4 mm from P_A = P_B = 0 with the sign as printed in (13).
        empty_with_tanh: the same with tanh(400 v).
    """

    parameters: PlantParameters
    chirps: Sequence[ChirpRun]
    frozen: ChirpRun
    frictionless: ChirpRun
    trajectories: Sequence[TrajectoryPair]
    double_rod: TrajectoryPair
    empty_with_sign: Recording
    empty_with_tanh: Recording


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
        empty_with_sign=_run_empty(setup, math.inf),
        empty_with_tanh=_run_empty(setup, setup.options.tanh_gain),
    )


def with_constant_volumes(parameters: PlantParameters) -> PlantParameters:
    """Return a cylinder whose volumes do not change: eqs. (10), (11) saturate at once."""
    return replace(parameters, h=1e-9)


def as_double_rod(parameters: PlantParameters) -> PlantParameters:
    """Return the cylinder that the reduced model averages to: equal areas, equal volumes."""
    area, volume = parameters.mean_area, 0.5 * parameters.total_volume
    return replace(parameters, A_A=area, A_B=area, V_A0=volume, V_B0=volume)


def _run_empty(setup: Setup, tanh_gain: float) -> Recording:
    """Return the run at 0.4 mm from pressures of zero, every step of it."""
    options = replace(setup.options, tanh_gain=tanh_gain)
    state = PlantState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return state_trajectory(replace(setup, options=options, state=state), amplitude=4e-4, every=1)


def _measure(setup: Setup, chirp: Chirp) -> ChirpRun:
    return measure_frequency_response(without_input_nonlinearities(setup, chirp.amplitude), chirp)
