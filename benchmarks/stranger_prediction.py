"""Strokes of strange machines beside what a model says of them, for `identification_strangers.py`.

A prediction gets the command, and position and pressures at the start of the stroke; it is held
against the machine itself, not against its sensors.
"""

import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from hil_bench.plants.hydraulic_cylinder.model import (
    FullOrderPlant,
    PlantInput,
    PlantOptions,
    PlantParameters,
    PlantState,
    Solver,
)

Values = npt.NDArray[np.float64]
TICK = 1e-3  # [s]
LIMITS = {"speed": 0.015, "pressure": 0.5e5, "arrival": 10e-3, "position": 1e-3}
"""What a prediction may be off by: a share, [Pa] beside 1 % of P_S, [s], [m]."""


class Stroke(NamedTuple):
    """A stroke: command [-], position [m] and pressures [Pa] each `TICK`, from its start."""

    command: Values
    x: Values
    P_A: Values
    P_B: Values
    supply: float


class Shown(NamedTuple):
    """A predicted stroke, each `TICK`; a pressure it does not know is not a number."""

    x: Values
    P_A: Values
    P_B: Values


class Predictor(Protocol):
    """A model of a machine."""

    def __call__(self, stroke: Stroke) -> Shown:
        """Predict a stroke."""


class Errors(NamedTuple):
    """Errors of prediction of a stroke: a share, Pa, s, m."""

    speed: float
    pressure: float
    arrival: float
    position: float


class BenchPlant(NamedTuple):
    """The bench's plant as a predictor.

    Attributes:
        parameters: of the plant.
        options: of the plant.
        dt: step [s].
        delay: of the command [s].
        nominal: supply pressure of a stroke for which P_S is that of the parameters, where the
            pressure before each stroke is known [Pa]; None where P_S is the same for all.
    """

    parameters: PlantParameters
    options: PlantOptions
    dt: float = 5e-5
    delay: float = 0.0
    nominal: float | None = None

    def fed(self, supply: float) -> "BenchPlant":
        """Return the plant with the supply pressure of a stroke."""
        if self.nominal is None:
            return self
        pressure = self.parameters.P_S * supply / self.nominal
        return self._replace(parameters=replace(self.parameters, P_S=pressure))

    def __call__(self, stroke: Stroke) -> Shown:
        """Run the plant under the command of a stroke, from where it began."""
        start = PlantState(stroke.x[0], 0.0, stroke.P_A[0], stroke.P_B[0], 0.0, 0.0)
        return run_bench(self.fed(stroke.supply), stroke.command, start, stroke.supply)


def run_bench(
    model: BenchPlant,
    command: Values,
    start: PlantState,
    supply: float | None = None,
    ticks: int = 1,
) -> Shown:
    """Run the bench's plant from a state, a command each `TICK`.

    Args:
        model: of the machine.
        command: a share of the full opening.
        start: at the first tick.
        supply: pressure of a supply unit at the start [Pa]; None for the unit's own.
        ticks: between two rows; the command counts as its mean over them.
    """
    plant = FullOrderPlant(
        model.parameters,
        options=model.options,
        solver=Solver.LINEARLY_IMPLICIT_MIDPOINT,
        dt=model.dt,
        state=start,
    )
    if supply is not None and model.options.supply is not None:
        plant.supply_pressure = supply
    late = delayed(command, model.delay) * model.parameters.full_opening
    spool = late[: len(late) // ticks * ticks].reshape(-1, ticks).mean(axis=1)
    steps = ticks * round(TICK / model.dt)
    rows = np.empty((len(spool), 3))
    for number, u in enumerate(spool.tolist()):
        rows[number] = plant.output.x, plant.output.P_A, plant.output.P_B
        plant.step(PlantInput(u), steps)
    return Shown(*rows.T)


def delayed(command: Values, delay: float) -> Values:
    """Return a command that is late by any time, as its mean over each tick."""
    if delay <= 0.0:
        return command
    edges = TICK * np.arange(len(command) + 1)
    total = np.concatenate([[0.0], np.cumsum(command) * TICK])
    return np.asarray(np.diff(np.interp(edges - delay, edges, total)) / TICK)


def errors_of(stroke: Stroke, shown: Shown, pressures: Sequence[str]) -> Errors:
    """Return the errors of a prediction: speed and pressures in the middle of the way."""
    way = np.sign(stroke.x[-1] - stroke.x[0])
    span = abs(stroke.x[-1] - stroke.x[0])
    travel = [way * (one.x - one.x[0]) for one in (stroke, shown)]
    times = [[_first(one, share * span) for one in travel] for share in (0.3, 0.7, 0.9)]
    true, model = (
        0.4 * span / max(late - early, TICK) for early, late in zip(*times[:2], strict=True)
    )
    middle = slice(int(times[0][0]), int(times[1][0]) + 1)
    pressure = max(
        abs(float(np.mean(getattr(stroke, name)[middle] - getattr(shown, name)[middle])))
        for name in pressures
    )
    off = stroke.x - shown.x
    arrival = abs(times[2][1] - times[2][0]) * TICK
    return Errors(abs(model / true - 1.0), pressure, arrival, float(np.sqrt(np.mean(off * off))))


def _first(travel: Values, goal: float) -> float:
    """Return the row, with its fraction, where a way is first as long as `goal`."""
    beyond = travel >= goal
    row = int(np.argmax(beyond))
    if not beyond[row]:
        return float(len(travel))
    step = travel[row] - travel[row - 1] if row else 0.0
    return float(row - (travel[row] - goal) / step) if step > 0.0 else float(row)


def is_within(errors: Errors, supply: float) -> bool:
    """Return True where all errors keep the limits, that of pressures where the model has them.

    Args:
        errors: of prediction; a pressure's is not a number where the model has no pressures.
        supply: P_S [Pa].
    """
    return (
        errors.speed <= LIMITS["speed"]
        and not errors.pressure > LIMITS["pressure"] + 0.01 * supply
        and errors.arrival <= LIMITS["arrival"]
        and errors.position <= LIMITS["position"]
    )


def together(errors: Sequence[Errors]) -> Errors:
    """Return the root mean square over strokes."""
    return Errors(*np.sqrt(np.mean(np.square(np.array(errors)), axis=0)).tolist())


class Logged(NamedTuple):
    """A file of a logger in SI units; a pressure that it lacks is not a number."""

    time: Values
    command: Values
    x: Values
    P_A: Values
    P_B: Values


def read_logged(path: Path, columns: Path) -> Logged:
    """Read a file of a logger by its map of columns, plainly, not by the bench's reader."""
    text = path.read_text(encoding="utf-8").replace(",", ".")
    header, *lines = text.splitlines()
    table = np.array([[float(one) for one in line.split(";")] for line in lines])
    names = header.split(";")
    mapped = tomllib.loads(columns.read_text(encoding="utf-8"))
    units = {"s": 1.0, "mm": 1e-3, "bar": 1e5, "%": 1e-2, "V": 1.0}

    def take(quantity: str) -> Values:
        if quantity not in mapped:
            return np.full(len(table), np.nan)
        one = mapped[quantity]
        raw = table[:, names.index(one["column"])]
        value = (raw * one.get("gain", 1.0) + one.get("offset", 0.0)) * units[one["unit"]]
        return np.asarray(value / one.get("full_scale", 1.0))

    return Logged(*map(take, ("time", "spool_setpoint", "position", "P_A", "P_B")))


def cut_strokes(logged: Logged, before: float = 0.15) -> list[Stroke]:
    """Cut a file into its strokes, each from a while before the valve opens to the next, even."""
    on = logged.command != 0.0
    opens = logged.time[1:][on[1:] & ~on[:-1]] - before
    ends = np.append(opens[1:], logged.time[-1])
    strokes = []
    for begin, end in zip(opens, ends, strict=True):
        times = np.arange(begin, end, TICK)
        last = np.clip(np.searchsorted(logged.time, times, side="right") - 1, 0, None)
        rows = [np.interp(times, logged.time, one) for one in (logged.x, logged.P_A, logged.P_B)]
        strokes.append(Stroke(logged.command[last], rows[0], rows[1], rows[2], np.nan))
    return strokes
