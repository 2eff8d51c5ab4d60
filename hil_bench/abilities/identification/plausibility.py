"""Records that no machine like the configured one gives: wrong units, columns that are swapped."""

import math

import numpy as np

from hil_bench.abilities.identification.record import PRESSURES, AxisRecord
from hil_bench.errors import ConfigError
from hil_bench.plants.hydraulic_cylinder.model import PlantOptions, PlantParameters
from hil_bench.units import BAR, MILLIMETRE_PER_SECOND

_WINDOW = 0.02  # [s] over which speeds are taken
_OFTEN = 10  # windows that must be as fast: fewer are disturbances
_TOO_FAST = 3.0  # times the speed without load, all pressure dropping over one edge
_TOO_HIGH = 5.0  # times the supply pressure: unequal areas and loads reach twice that and more
_TOO_LOW = 0.15


def check_plausible(
    record: AxisRecord, parameters: PlantParameters, options: PlantOptions
) -> list[str]:
    """Return doubts about a record of one recording, in words.

    Args:
        record: of the machine.
        parameters: as configured.
        options: as configured.

    Raises:
        ConfigError: speed or pressures are beyond anything that the configured machine does.
    """
    _check_speed(record, parameters)
    unit = options.supply
    supply = max(parameters.P_S, unit.relief_pressure if unit else 0.0)
    doubts = []
    for place, name in enumerate(PRESSURES, start=1):
        highest = float(record.measured[:, place].max())  # not a number where it is missing
        line = (
            f"{name} is {BAR.from_si(highest):.4g} bar at most, at a supply pressure of "
            f"{BAR.from_si(supply):.4g} bar; check its unit and gain, or supply_pressure_bar"
        )
        if highest > _TOO_HIGH * supply:
            raise ConfigError(line)
        if highest < _TOO_LOW * supply:
            doubts.append(line)
    return doubts


def _check_speed(record: AxisRecord, parameters: PlantParameters) -> None:
    """Refuse a position that is faster than the valve of the configured machine can make it.

    Raises:
        ConfigError: it is.
    """
    rows = max(1, round(_WINDOW / record.interval))
    position = record.measured[:, 0]
    if len(position) <= 2 * rows:
        return
    speeds = np.abs(position[rows:] - position[:-rows]) / (rows * record.interval)
    speed = float(np.quantile(speeds, 1.0 - min(0.05, _OFTEN * rows / len(speeds))))
    share = float(np.abs(record.setpoints).max()) / record.full_opening
    opening = min(share * parameters.full_opening, parameters.alpha)
    flow = parameters.K * opening * math.sqrt(parameters.P_S - parameters.P_T)
    fastest = flow / min(parameters.A_A, parameters.A_B)
    if speed > _TOO_FAST * fastest:
        shown, most = (MILLIMETRE_PER_SECOND.from_si(each) for each in (speed, fastest))
        raise ConfigError(
            f"the position changes by {shown:.4g} mm/s, and at set-points of up to {share:.2%} the "
            f"configured valve gives {most:.4g} mm/s without any load; check that the columns of "
            "position and spool_setpoint are those, and their units, gains and full_scale"
        )
