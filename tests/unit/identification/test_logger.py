"""Lost rows, clipped channels and filters of a logger: found where they are, and nowhere else."""

import numpy as np
import numpy.typing as npt
import pytest
from support.machine_record import FULL_OPENING, POSITION_NOISE, Machine, random_steps

from hil_bench.abilities.identification.logger import find_clipped, find_jumps, look_through
from hil_bench.abilities.identification.record import FLOORS, AxisRecord, join_records
from hil_bench.errors import ConfigError

TICK = 1e-3  # [s]
H = 0.25  # [m]

Values = npt.NDArray[np.float64]


@pytest.fixture(scope="module")
def recording():
    """Of 6 s, a third of them at rest; the piston is struck from one speed to another."""
    setpoints = random_steps(0.3e-3, 1e-3, 40, 150)
    for block in range(0, 40, 3):
        setpoints[150 * block : 150 * (block + 1)] = 0.0
    return Machine().record(setpoints)


def test_a_sound_record_has_nothing(recording):
    record = AxisRecord.of(recording, "axis1", FULL_OPENING)

    looked = look_through(record, H)

    assert looked.notes == ()
    assert looked.stretches == record.stretches
    assert not looked.clipped.any()


@pytest.mark.parametrize(("first", "lost"), [(2100, 2), (2500, 12), (4020, 3)])
def test_lost_rows_are_found_and_counted(recording, first, lost):
    """While the piston moves with a tenth of a metre a second and more."""
    position = recording["axis1.position"]
    speed = np.diff(position)[first - 1]
    assert abs(speed) > 0.05 * TICK

    (jump,) = find_jumps(np.delete(position, slice(first, first + lost)), POSITION_NOISE)

    assert jump.row == first - 1
    assert jump.lost == pytest.approx(lost, abs=1)
    assert jump.way == pytest.approx(lost * speed, rel=0.2)


def test_a_jump_is_what_its_step_is_beyond_the_two_steps_on_each_side():
    steps = 1e-4 * (1.0 + 0.1 * np.random.default_rng(8).standard_normal(400))
    steps[200] += 1e-3
    (jump,) = find_jumps(np.cumsum(steps), 1e-9)  # whose first step is steps[1]
    beside = (steps[198] + steps[199] + steps[201] + steps[202]) / 4.0
    assert jump == (199, pytest.approx(steps[200] - beside), round(steps[200] / beside) - 1)


def test_steps_of_a_coarse_encoder_are_no_lost_rows():
    """2.6 steps of the sensor a row are now two, now three, now four."""
    step, source = 59e-6, np.random.default_rng(3)
    way = 2.6 * step * np.arange(4000.0) + 15e-6 * source.standard_normal(4000)
    shown = step * np.rint(way / step)

    assert find_jumps(shown, 20e-6) == []
    lost = np.delete(shown, np.arange(2000, 2006))
    assert [jump.row for jump in find_jumps(lost, 20e-6)] == [1999]


def test_a_fit_does_not_reach_across_lost_rows(recording):
    cut = np.delete(recording, slice(2500, 2512))
    cut["time"] = TICK * np.arange(len(cut))  # an even column of time hides it

    looked = look_through(AxisRecord.of(cut, "axis1", FULL_OPENING), H)

    assert [(part.start, part.stop) for part in looked.stretches] == [(0, 2500), (2500, len(cut))]
    (note,) = looked.notes
    assert note.startswith("behind an even column of time the position jumps in 1 of ")
    assert "first at 2.499" in note
    assert note.endswith("rows are missing, about 12")


def test_a_record_that_is_full_of_lost_rows_is_refused(recording):
    table = recording.copy()
    table["axis1.position"] += 1e-3 * (np.arange(len(table)) // 200)  # a jump each 0.2 s

    with pytest.raises(ConfigError, match=r"lacks rows in \d+ places behind an even column"):
        look_through(AxisRecord.of(table, "axis1", FULL_OPENING), H)


@pytest.mark.parametrize("coarse", [0.0, 1e3])
def test_a_clipped_channel_is_found_with_its_end(recording, coarse):
    values = recording["axis1.P_A"]
    if coarse:
        values = coarse * np.rint(values / coarse)
    end = float(np.quantile(values, 0.9))

    marks, ends = find_clipped(np.minimum(values, end), FLOORS[1])

    assert ends == [end]
    # A tenth of the rows is beyond; what touches the end for a few rows only is not told apart.
    assert 0.05 < marks.mean() < 0.12


def test_a_column_without_noise_that_rests_at_its_highest_is_not_clipped():
    course = np.concatenate([np.linspace(0.0, 0.2, 3000), np.full(1000, 0.2)])

    assert find_clipped(course, FLOORS[0])[1] == []


def test_a_sensor_that_is_clipped_at_both_ends_is_found():
    way = 0.08 * np.sin(np.linspace(0.0, 40.0, 8000))
    noisy = way + 2e-6 * np.random.default_rng(4).standard_normal(8000)

    marks, ends = find_clipped(np.clip(noisy, -0.04, 0.04), FLOORS[0], 0.08)

    assert ends == [-0.04, 0.04]
    # A sine is beyond half its size for two thirds of its time.
    assert marks.mean() == pytest.approx(2 / 3, abs=0.03)


def test_a_piston_in_its_stop_behind_an_encoder_is_no_clipped_sensor():
    way = np.clip(0.3 * np.sin(np.linspace(0.0, 9.0, 8000)), -0.1605, 0.1605)
    noisy = way + 4e-7 * np.random.default_rng(4).standard_normal(8000)
    counted = 5e-6 * np.rint(noisy / 5e-6)

    assert find_clipped(counted, FLOORS[0])[1]
    assert find_clipped(counted, FLOORS[0], 0.160)[1] == []


def test_clipped_rows_count_for_nothing(recording):
    table = recording.copy()
    end = np.quantile(table["axis1.P_A"], 0.9)
    table["axis1.P_A"] = np.minimum(table["axis1.P_A"], end)
    record = AxisRecord.of(table, "axis1", FULL_OPENING)

    looked = look_through(record, H)

    rows = np.flatnonzero(looked.clipped[:, 1])
    assert looked.clipped[rows].tolist() == [[False, True, False]] * len(rows)
    assert f"P_A is clipped at {end / 1e5:.4g} bar" in looked.notes[0]
    assert looked.noise[1] == pytest.approx(5e3, rel=0.3)  # as added; the clipped rows have none
    both = join_records([record, looked])
    assert both.clipped.sum() == looked.clipped.sum()
