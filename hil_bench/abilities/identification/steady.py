"""The plateaus of strokes, where speed and pressures stand: where the search begins."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.identification.fit import Bench, find_middle
from hil_bench.abilities.identification.machine import Unknown, read_values
from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model.extensions import ATMOSPHERE
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import PlantParameters
from hil_bench.plants.hydraulic_cylinder.model.spool import orifice_state
from hil_bench.plants.hydraulic_cylinder.model.steady_motion import steady_motion

Values = npt.NDArray[np.float64]

_SPEED, _PRESSURE = 0.01, 1e5  # a share and [Pa]: residuals of one
_STEP = 1e-4  # of a variable, for slopes
_AWFUL = 1e3
_STANDS = 1e-3  # of the speed that was recorded: no less counts
_ROUNDS = 30
_LEFT = 1e5  # [Pa] beyond the tank's: an accumulator is never emptier


class Plateau(NamedTuple):
    """Like strokes in the middle of their way.

    Attributes:
        session: the recording.
        setpoint: of the spool [m].
        speed: of the piston, without its sign [m/s].
        travel: from the start of the stroke to the middle of its way [m].
        pressures: P_A and P_B; not a number for what is missing [Pa].
    """

    session: int
    setpoint: float
    speed: float
    travel: float
    pressures: Values


def find_plateaus(bench: Bench) -> list[Plateau]:
    """Return the plateaus of a record, one for like strokes of a recording."""
    found: dict[tuple[int, int], list[Plateau]] = {}
    record = bench.course.record
    for stroke in bench.course.strokes:
        measured = bench.measured(stroke)
        setpoints = bench.setpoints_of(stroke)
        inside = find_middle(measured, setpoints, record.full_opening)
        if inside is None:
            continue
        part = measured[inside.start : inside.stop]
        u = float(setpoints[inside.start : inside.stop].mean())
        speed = float(np.polyfit(record.interval * np.arange(len(part)), part[:, 0], 1)[0])
        key = (stroke.session, round(200.0 * u / record.full_opening))
        travel = abs(float(part[:, 0].mean() - stroke.start[0]))
        plateau = Plateau(stroke.session, u, abs(speed), travel, part[:, 1:].mean(axis=0))
        found.setdefault(key, []).append(plateau)
    return [
        Plateau(
            like[0].session,
            float(np.mean([one.setpoint for one in like])),
            float(np.median([one.speed for one in like])),
            float(np.median([one.travel for one in like])),
            np.mean([one.pressures for one in like], axis=0),
        )
        for like in found.values()
    ]


def fit_plateaus(bench: Bench, unknowns: Sequence[Unknown], begin: Values) -> tuple[Values, float]:
    """Return the variables of unknowns that fit the plateaus of a record best, and their cost.

    Args:
        bench: machine and record.
        unknowns: that are sought.
        begin: where the search begins; what it returns where there is no plateau.
    """
    from scipy.optimize import least_squares  # noqa: PLC0415 - an extra

    plateaus = find_plateaus(bench)
    if not plateaus:
        return begin, 0.0
    start, spread, low, high = np.array(
        [(one.start, one.spread, one.low, one.high) for one in unknowns]
    ).T

    def off(variables: Values) -> Values:
        expected = (variables - start) / spread
        try:
            machine = bench.machine(read_values(unknowns, variables))
        except ParameterError:
            return np.concatenate([np.full(3 * len(plateaus), _AWFUL), expected])
        p, options = machine.parameters, machine.options
        alpha = p.alpha if options.alpha_negative is None else options.alpha_negative
        beta = p.beta if options.beta_negative is None else options.beta_negative
        rows = []
        for one in plateaus:
            z = abs(orifice_state(one.setpoint, (p.alpha, p.beta, alpha, beta)))
            fed, unlimited = _fed(p, options, one)
            try:
                found = steady_motion(fed, unlimited, extends=one.setpoint > 0.0, z=z)
            except ZeroDivisionError:  # an edge that does not open at all
                rows += [_AWFUL] * 3
                continue
            pressures = np.array([found.P_A, found.P_B]) + machine.offsets[one.session][1:]
            missed = np.nan_to_num((pressures - one.pressures) / _PRESSURE)
            rows += [math.log(max(found.speed / one.speed, _STANDS)) / _SPEED, *missed]
        return np.concatenate([rows, expected])

    room = 1e-3 * (high - low)
    found = least_squares(
        off,
        np.clip(begin, low + room, high - room),
        bounds=(low, high),
        loss="soft_l1",
        x_scale="jac",
        diff_step=_STEP,
        max_nfev=_ROUNDS,
    )
    return np.asarray(found.x), float(found.cost)


def _fed(
    p: PlantParameters, options: PlantOptions, one: Plateau
) -> tuple[PlantParameters, PlantOptions]:
    """Return the plant at the supply pressure that an accumulator has left in mid-stroke."""
    unit = options.supply
    if unit is None or unit.variable is not None or not unit.accumulator_volume:
        return p, options
    area = p.A_A if one.setpoint > 0.0 else p.A_B
    beyond = area * one.speed - unit.pump_flow
    pressure = unit.relief_pressure - min(beyond, 0.0) / unit.relief_gradient
    if beyond > 0.0:
        n, full = unit.gas_exponent, pressure + ATMOSPHERE
        share = (unit.precharge_pressure + ATMOSPHERE) / full
        gas = unit.accumulator_volume * share ** (1.0 / n)
        drawn = beyond * one.travel / one.speed
        pressure = full * (1.0 + drawn / gas) ** -n - ATMOSPHERE
    return replace(p, P_S=max(pressure, p.P_T + _LEFT)), replace(options, supply=None)
