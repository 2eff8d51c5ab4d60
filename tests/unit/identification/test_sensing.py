"""Sensors that are behind what they measure."""

from dataclasses import replace

import numpy as np
import pytest
from support.machine_record import FULL_OPENING, Machine, random_steps

from hil_bench.abilities.identification.identify import Identification, identify
from hil_bench.abilities.identification.record import AxisRecord
from hil_bench.abilities.identification.sensing import sense
from hil_bench.abilities.identification.unknowns import Sensors
from hil_bench.plants.hydraulic_cylinder.model import PlantOptions, paper_parameters

STEP = 1e-4
DELAY, LAG = 1.5e-3, 0.7e-3  # [s], of the position and of the pressures


def test_a_ramp_comes_late_by_delay_and_lag() -> None:
    motion = np.repeat(np.linspace(0.0, 1.0, 101)[np.newaxis, :, np.newaxis], 3, axis=2)

    shown = sense(motion, 1e-3, Sensors(2e-3, 3e-3, 0.0, 4e-3), every=10)

    # 0.01 a millisecond, after 10, 20, ... ms
    rows = 0.1 * np.arange(1, 11)
    assert shown[0, :, 0] == pytest.approx(rows - 0.05)
    assert shown[0, :, 1] == pytest.approx(rows - 0.04)


@pytest.mark.parametrize(("intervals", "rows"), [(99, 9), (100, 10), (9, 0)])
def test_rows_come_after_whole_steps_alone(intervals: int, rows: int) -> None:
    shown = sense(np.zeros((2, intervals + 1, 3)), 1e-3, Sensors(0.0, 0.0, 0.0, 0.0), every=10)
    assert shown.shape == (2, rows, 3)


def test_a_step_behind_a_lag_fades_as_an_exponential() -> None:
    motion = np.zeros((1, 401, 3))
    motion[:, 100:] = 1.0
    lag = 10e-3

    shown = sense(motion, 1e-4, Sensors(0.0, lag, 0.0, lag), every=100)

    # the step begins between the intervals 99 and 100, so 0.05 ms before 10 ms
    expected = 1.0 - np.exp(-(np.arange(2, 5) * 10e-3 - 9.95e-3) / lag)
    assert shown[0, 1:, 2] == pytest.approx(expected, abs=1e-4)


def late(values: np.ndarray, rows: float) -> np.ndarray:
    """Return values some rows later, by linear interpolation."""
    places = np.arange(len(values)) - rows
    return np.interp(places, np.arange(len(values)), values)


@pytest.fixture(scope="module")
def found() -> Identification:
    """Of a position that comes 1.5 ms late and pressures behind a lag of 0.7 ms."""
    machine = Machine(parameters=replace(paper_parameters(), w=0.021, m=22.0), tick=1e-4)
    setpoints = np.repeat(random_steps(0.5e-3, 1e-3, 34, 100), 10)
    recording = machine.record(setpoints)
    fade = np.exp(-1e-4 / LAG)
    for name in ("P_A", "P_B"):
        values = recording[f"axis1.{name}"]
        shown = values[0]
        for row in range(len(values)):
            shown = values[row] + fade * (shown - values[row])
            values[row] = shown
    recording["axis1.position"] = late(recording["axis1.position"], DELAY / 1e-4)
    record = AxisRecord.of(recording[9::10], "axis1", FULL_OPENING)
    names = ("w", "E", "m", "position_delay", "pressure_lag")
    return identify(
        record, paper_parameters(), PlantOptions.bench(), step=STEP, names=names, starts=1
    )


@pytest.mark.parametrize(
    ("name", "true", "near"),
    [
        ("w", 0.021, 1e-4),
        ("m", 22.0, 0.3),
        ("E", 1e8, 1e6),
        ("position_delay", DELAY, 0.05e-3),
        ("pressure_lag", LAG, 0.1e-3),
    ],
)
def test_delay_and_lag_are_found_beside_the_parameters(
    found: Identification, name: str, true: float, near: float
) -> None:
    (estimate,) = [estimate for estimate in found.told if estimate.name == name]

    assert estimate.value == pytest.approx(true, abs=near)
