"""Records of virtual machines, as identification reads them."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.analysis.simulation import Setup, simulate
from hil_bench.abilities.analysis.study import make_table
from hil_bench.outside.recording.channels import Channel, Recording
from hil_bench.plants.hydraulic_cylinder.model import (
    PlantOptions,
    PlantParameters,
    PlantState,
    Solver,
    paper_parameters,
)

FULL_OPENING = 1.3e-3  # alpha + beta of Table I [m]
POSITION_NOISE, PRESSURE_NOISE = 2e-6, 5e3  # [m], [Pa]

Values = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Machine:
    """A machine with sensors: of `parameters`, driven by a new set-point each `tick` [s]."""

    parameters: PlantParameters = field(default_factory=paper_parameters)
    options: PlantOptions = field(default_factory=PlantOptions.bench)
    state: PlantState | None = None
    tick: float = 1e-3
    step: float = 1e-4
    axis: str = "axis1"
    offset: float = 0.0  # of the sensor of P_A [Pa]
    has_spool: bool = False

    def record(self, setpoints: Values) -> Recording:
        """Return what the sensors show under set-points [m], with noise from a fixed seed."""
        every = round(self.tick / self.step)
        setup = Setup(
            parameters=self.parameters,
            options=self.options,
            solver=Solver.LINEARLY_IMPLICIT_MIDPOINT,
            dt=self.step,
            state=self.state,
        )
        run = simulate(setup, np.repeat(setpoints, every), every=every)
        source = np.random.default_rng(11)
        noise = source.standard_normal((3, len(run)))
        columns = {
            Channel("time", "s"): run["time"],
            Channel(f"{self.axis}.position", "m"): run["x"] + POSITION_NOISE * noise[0],
            Channel(f"{self.axis}.P_A", "Pa"): run["P_A"] + PRESSURE_NOISE * noise[1] + self.offset,
            Channel(f"{self.axis}.P_B", "Pa"): run["P_B"] + PRESSURE_NOISE * noise[2],
            Channel(f"{self.axis}.spool_setpoint", "-"): setpoints / FULL_OPENING,
        }
        if self.has_spool:
            nu = step_spool(self.parameters, setpoints, self.tick)
            columns[Channel(f"{self.axis}.spool_position", "-")] = nu / FULL_OPENING
        return make_table(columns)


def step_spool(parameters: PlantParameters, setpoints: Values, tick: float) -> Values:
    """Return the spool's position [m] by ten thousand small steps of eq. (1) a second and more."""
    steps = 200
    dt = tick / steps
    nu = nu_dot = 0.0
    seen = []
    for u in setpoints.tolist():
        for _ in range(steps):
            nu_dot += dt * (
                parameters.omega_0**2 * (u - nu) - 2.0 * parameters.xi * parameters.omega_0 * nu_dot
            )
            nu += dt * nu_dot
        seen.append(nu)
    return np.array(seen)


def random_steps(lowest: float, highest: float, count: int, rows: int) -> Values:
    """Return set-points [m] that change each `rows` rows to a size and sign by chance, seeded."""
    source = np.random.default_rng(1)
    return np.concatenate(
        [
            np.full(rows, source.choice([-1.0, 1.0]) * source.uniform(lowest, highest))
            for _ in range(count)
        ]
    )
