"""Runs of either model under any spool set-point over time, as structured arrays."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from hil_bench.outside.recording.channels import TIME, Channel, Recording, recording_dtype
from hil_bench.plants.hydraulic_cylinder.model import (
    FullOrderPlant,
    Model,
    PlantInput,
    PlantModel,
    PlantOptions,
    PlantParameters,
    PlantState,
    ReducedOrderPlant,
    Solver,
)

Signal = npt.NDArray[np.float64]

CHANNELS = (
    TIME,
    Channel("u", "m"),
    Channel("x", "m"),
    Channel("v", "m/s"),
    Channel("P_A", "Pa"),
    Channel("P_B", "Pa"),
    Channel("P_L", "Pa"),
    Channel("z", "m"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """A simulation set-up; the defaults are those of the paper's section IV-B.

    Attributes:
        parameters: of the plant.
        model: which of both.
        options: what the paper leaves open.
        solver: of the equations.
        dt: step of the solver [s].
        state: at the start; None for the balanced state of rest at mid-stroke.
        delay: in place of the spool's lag, in the reduced model [s].
    """

    parameters: PlantParameters
    model: Model = Model.FULL_ORDER
    options: PlantOptions = field(default_factory=PlantOptions.paper)
    solver: Solver = Solver.FORWARD_EULER
    dt: float = 1e-4
    state: PlantState | None = None
    delay: float = 0.0


def without_input_nonlinearities(setup: Setup, largest: float) -> Setup:
    """Return the set-up with a valve that has no dead-zone and no saturation, eq. (2): z = nu.

    The saturation goes where no set-point of that size takes the spool: beyond `largest` times the
    integral of eq. (1)'s impulse response in size, coth(pi xi / (2 sqrt(1 - xi²))).

    Args:
        setup: what is simulated.
        largest: set-point in the run [m].
    """
    return replace(
        setup,
        parameters=replace(setup.parameters, beta=0.0, alpha=largest * _reach(setup.parameters.xi)),
        options=replace(setup.options, alpha_negative=None, beta_negative=None),
    )


def _reach(xi: float) -> float:
    """Return the peak of the spool's position as a multiple of the largest set-point."""
    if xi >= 1.0:
        return 1.0
    return 1.0 / math.tanh(math.pi * xi / (2.0 * math.sqrt(1.0 - xi * xi)))


def simulate(setup: Setup, setpoints: Signal, *, every: int = 1) -> Recording:
    """Return a run in which the spool set-point takes a new value at each step.

    Args:
        setup: what is simulated.
        setpoints: u [m], held over one step each, shape (steps,).
        every: how many steps lie between two rows.

    Returns:
        A row after each `every`-th step with the fields of `CHANNELS`, time first; the set-point of
        a row is the one that led to it.
    """
    plant = build_plant(setup)
    rows = np.empty((len(setpoints) // every, len(CHANNELS)))
    for number, u in enumerate(np.asarray(setpoints, dtype=np.float64).tolist(), start=1):
        seen = plant.step(PlantInput(u))
        if number % every == 0:
            pressures = (seen.P_A, seen.P_B, seen.P_A - seen.P_B)
            rows[number // every - 1] = (number * setup.dt, u, seen.x, seen.v, *pressures, seen.z)
    return rows.view(recording_dtype(CHANNELS)).reshape(-1)


def build_plant(setup: Setup) -> PlantModel:
    """Return the plant that a set-up describes, at its start."""
    if setup.model is Model.REDUCED:
        return ReducedOrderPlant(
            setup.parameters,
            options=setup.options,
            solver=setup.solver,
            dt=setup.dt,
            state=setup.state,
            delay=setup.delay,
        )
    return FullOrderPlant(
        setup.parameters,
        options=setup.options,
        solver=setup.solver,
        dt=setup.dt,
        state=setup.state,
    )
