"""Simulations of the model: one, many at once, and trajectories from them."""

import math
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import groupby

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.analysis.steady_motion import NyquistError
from hil_bench.errors import ParameterError, require_extra
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
from hil_bench.plants.hydraulic_cylinder.model.batch import LANES, SEEN, run_plants
from hil_bench.plants.hydraulic_cylinder.model.kernel import IS_COMPILED
from hil_bench.plants.hydraulic_cylinder.model.stepping import SPOOL_SETPOINT_LIMIT
from hil_bench.plants.hydraulic_cylinder.model.validation import require_positive

# Runs of either model under any spool set-point over time, as structured arrays.

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
        setup.parameters, options=setup.options, solver=setup.solver, dt=setup.dt, state=setup.state
    )


# State trajectories under a sinusoidal set-point (Ruderman 2017, section IV-C and fig. 6).

_LONGEST = 20_000_000  # steps: a gigabyte


def state_trajectory(
    setup: Setup,
    *,
    amplitude: float,
    frequency: float = 0.1,
    duration: float = 10.0,
    every: int = 5,
) -> Recording:
    """Return a run under u = amplitude sin(2 pi frequency t).

    Args:
        setup: what is simulated.
        amplitude: of the spool set-point [m].
        frequency: of the spool set-point [Hz].
        duration: [s].
        every: how many steps lie between two rows.

    Raises:
        NyquistError: the frequency reaches half of the solver's sampling frequency.
        ParameterError: a value is not positive, or there are more steps than memory should hold.
    """
    require_positive("amplitude", amplitude, "m")
    require_positive("frequency", frequency, "Hz")
    require_positive("duration", duration, "s")
    if frequency >= 0.5 / setup.dt:
        raise NyquistError(
            f"sine of {frequency:g} Hz: must stay below the Nyquist frequency of "
            f"{0.5 / setup.dt:g} Hz, half of one sample each {setup.dt:g} s"
        )
    steps = round(duration / setup.dt)
    if not 1 <= steps <= _LONGEST:
        raise ParameterError(
            f"duration = {duration:g} s: {steps} steps of {setup.dt:g} s; 1 to {_LONGEST} are right"
        )
    time = np.arange(steps) * setup.dt
    return simulate(setup, amplitude * np.sin(2.0 * math.pi * frequency * time), every=every)


# Runs of many plants under set-points: sweeps, Monte Carlo, identification.


def simulate_batch(
    setups: Sequence[Setup],
    setpoints: Signal,
    *,
    every: int = 1,
    progress: bool = False,
    threads: int | None = None,
) -> Recording:
    """Return a run of each set-up, bit for bit what `simulate` returns for it.

    Full-order plants without extensions on the default solver run side by side, sixteen in a block
    and a block a thread; anything else runs one by one.

    Args:
        setups: what is simulated.
        setpoints: u [m], held over one step each: shape (steps,) for all set-ups, or
            (set-ups, steps).
        every: how many steps lie between two rows.
        progress: whether a bar on standard error shows the runs done, if that is a terminal.
        threads: at most; None for one a processor.

    Returns:
        Shape (set-ups, rows), with the fields of `CHANNELS`, time first.

    Set-points that do not fit the set-ups or are not finite are refused, and a set-up that cannot
    be, with its number.
    """
    require_extra("tqdm", "a batch")
    from tqdm import tqdm  # noqa: PLC0415 - an extra

    inputs = _inputs(setups, setpoints, every)
    result = np.empty((len(setups), inputs.shape[1] // every), dtype=recording_dtype(CHANNELS))

    def run(job: range) -> int:
        result[job.start : job.stop] = _run(setups, inputs, job, every)
        return len(job)

    with (
        ThreadPoolExecutor(threads or os.cpu_count()) as pool,
        tqdm(total=len(setups), unit="run", disable=None if progress else True) as bar,
    ):
        for count in pool.map(run, _jobs(setups)):
            bar.update(count)
    return result


def _inputs(setups: Sequence[Setup], setpoints: Signal, every: int) -> Signal:
    """Return the set-points of each set-up, shape (set-ups, steps).

    Raises:
        ParameterError: they do not fit, or one is not finite.
    """
    inputs = np.asarray(setpoints, dtype=np.float64)
    if inputs.ndim not in {1, 2} or (inputs.ndim == 2 and len(inputs) != len(setups)):
        raise ParameterError(
            f"setpoints of shape {inputs.shape} for {len(setups)} set-ups: "
            f"(steps,) or ({len(setups)}, steps) is right"
        )
    if not np.isfinite(inputs).all():
        raise ParameterError("setpoints: NaN or infinite; all must be finite")
    if every < 1:
        raise ParameterError(f"every = {every}: must be 1 or greater")
    return np.broadcast_to(inputs, (len(setups), inputs.shape[-1]))


def _jobs(setups: Sequence[Setup]) -> Iterator[range]:
    """Yield which set-ups to run at once: neighbours that fit one block, or a single one."""
    for dt, group in groupby(range(len(setups)), lambda number: _block_step(setups[number])):
        numbers = list(group)
        size = 1 if dt is None else LANES
        for start in range(numbers[0], numbers[-1] + 1, size):
            yield range(start, min(start + size, numbers[-1] + 1))


def _block_step(setup: Setup) -> float | None:
    """Return the step [s] if the set-up can run in a block; None if it must run alone."""
    is_plain = (
        IS_COMPILED
        and setup.model is Model.FULL_ORDER
        and setup.solver is Solver.LINEARLY_IMPLICIT_MIDPOINT
        and not setup.options.is_extended
    )
    return setup.dt if is_plain else None


def _run(setups: Sequence[Setup], inputs: Signal, job: range, every: int) -> Recording:
    """Return the runs of a job, shape (set-ups, rows).

    Raises:
        ParameterError: a set-up cannot be; the message says which.
    """
    plants = []
    for number in job:
        try:
            plants.append(build_plant(setups[number]))  # which checks it, too
        except ParameterError as error:
            raise ParameterError(f"set-up {number}: {error}") from None
    if _block_step(setups[job.start]) is None:
        return simulate(setups[job.start], inputs[job.start], every=every)
    return _run_block(plants, inputs[job.start : job.stop], every)


def _run_block(plants: Sequence[PlantModel], inputs: Signal, every: int) -> Recording:
    dt = plants[0].dt
    seen = run_plants(
        [(plant.parameters, plant.options, plant.state) for plant in plants],
        np.clip(inputs, -SPOOL_SETPOINT_LIMIT, SPOOL_SETPOINT_LIMIT),
        dt=dt,
        every=every,
    )
    rows = np.empty(seen.shape[:2], dtype=recording_dtype(CHANNELS))
    rows["time"] = np.arange(1, seen.shape[1] + 1) * every * dt
    rows["u"] = inputs[:, every - 1 :: every][:, : seen.shape[1]]
    for number, name in enumerate(SEEN):
        rows[name] = seen[:, :, number]
    rows["P_L"] = rows["P_A"] - rows["P_B"]
    return rows
