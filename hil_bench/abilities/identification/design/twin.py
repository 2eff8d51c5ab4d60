"""The machine as it is known, run under set-points."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hil_bench.plants.hydraulic_cylinder.model import (
    FullOrderPlant,
    PlantInput,
    PlantOptions,
    PlantParameters,
    Solver,
    balanced_state,
)

Values = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Twin:
    """The model of the machine.

    Attributes:
        axis: its name.
        parameters: as far as they are known.
        options: of the plant.
        step: of the solver [s].
        interval: between two rows of the recording [s].
        full_opening: spool position that a set-point of 1 stands for [m].
    """

    axis: str
    parameters: PlantParameters
    options: PlantOptions
    step: float
    interval: float
    full_opening: float

    def run(self, setpoints: Values, position: float) -> Values:
        """Return the states under set-points, from rest.

        Args:
            setpoints: of each row, as shares of the full opening, shape (rows,).
            position: at the start [m].

        Returns:
            Position, velocity and both pressures after each row, shape (rows, 4) [m, m/s, Pa, Pa].
        """
        every = max(1, round(self.interval / self.step))
        plant = FullOrderPlant(
            self.parameters,
            options=self.options,
            solver=Solver.LINEARLY_IMPLICIT_MIDPOINT,
            dt=self.interval / every,
            state=balanced_state(self.parameters, x=position, F_L=self.options.load_at(position)),
        )
        states = np.empty((len(setpoints), 4))
        for row, u in enumerate((setpoints * self.full_opening).tolist()):
            given = PlantInput(u)
            seen = plant.step(given)
            for _ in range(every - 1):
                seen = plant.step(given)
            states[row] = seen.x, seen.v, seen.P_A, seen.P_B
        return states
