"""Two recordings of a strange machine, between which nothing or one thing has changed.

Nothing is not quite nothing: between any two recordings the oil is warmer or colder, the supply and
the friction differ by what differs from day to day, and so do the sensors' offsets.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from support.strange_logger import Logger, draw_logger
from support.strange_machines import Stranger, draw
from support.strange_plant import Machine


class Defect(NamedTuple):
    """A change of a machine or of a sensor.

    Attributes:
        name: as an engineer says it.
        unit: of its size.
        size: that it has where no other is asked for.
        change: makes the machine that has it.
    """

    name: str
    unit: str
    size: float
    change: Callable[[Machine, float], Machine]


class Pair(NamedTuple):
    """A machine before and after, each with its logger; None for no defect."""

    before: tuple[Stranger, Logger]
    after: tuple[Stranger, Logger]
    defect: Defect | None
    size: float


def _leak(m: Machine, size: float) -> Machine:
    return replace(m, leakage=m.leakage + size / 6e4 / 1e5)


def _wear(m: Machine, size: float) -> Machine:
    pa, at, pb, bt = m.overlaps
    return replace(m, overlaps=(pa - 0.01 * size, at, pb, bt))


def _trap(m: Machine, size: float) -> Machine:
    return replace(m, air=m.air + 0.01 * size)


def _rub(m: Machine, size: float) -> Machine:
    more = {
        name: tuple((1.0 + 0.01 * size) * one for one in getattr(m, name))
        for name in ("coulomb", "static", "viscous")
    }
    return replace(m, **more)


def _starve(m: Machine, size: float) -> Machine:
    return replace(m, supply=(1.0 - 0.01 * size) * m.supply)


def _keep(m: Machine, _size: float) -> Machine:
    return m


SENSOR = "sensor offset"
DEFECTS = (
    Defect("leakage across the piston", "l/min/bar", 0.01, _leak),
    Defect("worn edge", "% of the stroke", 3.0, _wear),
    Defect("trapped air", "%", 3.0, _trap),
    Defect("friction up", "%", 60.0, _rub),
    Defect("supply down", "%", 10.0, _starve),
    Defect(SENSOR, "bar", 3.0, _keep),
)


def draw_pair(seed: int, number: int, defect: Defect | None = None, scale: float = 1.0) -> Pair:
    """Draw a pair of recordings: the same for the same seed and number.

    Args:
        seed: of all.
        number: of the pair.
        defect: None for what is healthy.
        scale: of the defect's size; beside it each is drawn 1 to 1.5 times as large.
    """
    rng = np.random.default_rng([seed, number, 3])
    stranger = draw(seed, 100 + number)
    logger = replace(draw_logger(seed, stranger), jitter=0.05, pressures=("P_A", "P_B"))
    m = stranger.machine
    rough = 1.0 + 0.03 * rng.standard_normal()
    daily = replace(
        m,
        supply=m.supply * (1.0 + 0.003 * rng.standard_normal()),
        coulomb=tuple(rough * one for one in m.coulomb),
        static=tuple(rough * one for one in m.static),
    )
    size = 0.0
    offsets = np.array(logger.pressure_offsets)
    offsets += 0.03e5 * rng.standard_normal(2)
    if defect is not None:
        size = defect.size * scale * rng.uniform(1.0, 1.5)
        daily = defect.change(daily, size)
        if defect.name == SENSOR:
            offsets[:, rng.integers(2)] += size * 1e5
    later = replace(stranger, machine=daily, cool=stranger.cool + 2.0 * rng.standard_normal())
    after = later, replace(logger, pressure_offsets=tuple(map(tuple, offsets)))
    return Pair((stranger, logger), after, defect, size)
