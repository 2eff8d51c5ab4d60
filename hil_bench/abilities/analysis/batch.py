"""Runs of many plants under set-points: sweeps, Monte Carlo, identification."""

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import groupby

import numpy as np

from hil_bench.abilities.analysis.simulation import CHANNELS, Setup, Signal, build_plant, simulate
from hil_bench.errors import ParameterError
from hil_bench.extras import require_extra
from hil_bench.outside.recording.channels import Recording, recording_dtype
from hil_bench.plants.hydraulic_cylinder.model import Model, PlantModel, Solver
from hil_bench.plants.hydraulic_cylinder.model.batch import LANES, SEEN, run_plants
from hil_bench.plants.hydraulic_cylinder.model.kernel import IS_COMPILED
from hil_bench.plants.hydraulic_cylinder.model.stepping import SPOOL_SETPOINT_LIMIT


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
