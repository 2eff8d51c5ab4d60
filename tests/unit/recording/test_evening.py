"""Rows of loggers whose clock is uneven become even, and what was done is said."""

import numpy as np
import pytest

from hil_bench.abilities.analysis.study import make_table
from hil_bench.abilities.recording.quantities import make_even
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import Channel

NAMES = ["lift.position", "lift.spool_setpoint", "lift.P_A"]


def recording(times, position=None, setpoint=None):
    """A piston that moves at 0.1 m/s, and a valve that opens at 1 s."""
    times = np.asarray(times, dtype=float)
    return make_table(
        {
            Channel("time", "s"): times,
            Channel("lift.position", "m"): 0.1 * times if position is None else position,
            Channel("lift.spool_setpoint", "-"): np.where(times < 1.0, 0.0, 0.5)
            if setpoint is None
            else setpoint,
            Channel("lift.P_A", "Pa"): np.full(len(times), 1e5),
        }
    )


def test_even_rows_stay_as_they_are():
    given = recording(2e-3 * np.arange(1000))
    even, notes = make_even(given, NAMES)
    assert even is given
    assert notes == ()


def test_rows_behind_a_pause_are_not_moved_to_the_grid_of_those_before_it():
    """A commissioning pauses between its steps by times that are no multiples of its rows.

    To interpolate between such rows takes noise and fast changes out of them.
    """
    rows = 2e-3 * np.arange(1000)
    times = np.concatenate([rows, 2.001 + rows, 4.018 + rows])
    given = recording(times)
    even, notes = make_even(given, NAMES)
    assert even is given
    assert notes == ()


def test_jitter_is_taken_out_by_the_times_that_the_logger_gives():
    source = np.random.default_rng(3)
    times = 2e-3 * np.arange(1000) + 5e-4 * source.uniform(-1.0, 1.0, 1000)
    even, notes = make_even(recording(times), NAMES)
    assert np.diff(even["time"]) == pytest.approx(2e-3, rel=1e-9)
    # 0.1 m/s at any time, however it was sampled
    assert even["lift.position"] == pytest.approx(0.1 * even["time"], abs=1e-12)
    assert "interpolated at 2 ms" in notes[0]


def test_little_jitter_leaves_no_gaps():
    """At 5 % of a row, hardly a step is a fifth too long: left as they are, those were gaps."""
    source = np.random.default_rng(4)
    times = np.sort(2e-3 * (np.arange(2000) + 0.05 * source.standard_normal(2000)))
    assert (np.abs(np.diff(times) / 2e-3 - 1.0) > 0.2).sum() in range(1, 19)

    even, _ = make_even(recording(times), NAMES)

    assert np.diff(even["time"]) == pytest.approx(2e-3, rel=1e-6)
    assert even["lift.position"] == pytest.approx(0.1 * even["time"], abs=1e-12)


def test_a_setpoint_is_not_interpolated():
    times = np.array([0.0, 0.002, 0.003, 0.006, 0.008, 0.0101, 0.012, 0.014, 0.016, 0.018])
    even, _ = make_even(recording(times, setpoint=np.where(times < 0.009, 0.0, 0.5)), NAMES)
    assert set(even["lift.spool_setpoint"]) == {0.0, 0.5}


def test_a_setpoint_changes_half_way_between_two_rows():
    """Where it changed is not known: the rows at even times have that of the row that is nearer."""
    times = 0.01 * np.arange(100) + np.where(np.arange(100) % 2, 0.003, 0.0)
    even, _ = make_even(recording(times, setpoint=np.where(times < 0.105, 0.0, 0.5)), NAMES)
    # steps of 13 and 7 ms in turns, 0.093 and 0.100 s, then 0.113 s: half-way is 0.1065 s
    step = even["time"][np.flatnonzero(np.diff(even["lift.spool_setpoint"]))[0]]
    assert step < 0.1065 <= step + np.diff(even["time"])[0]


def test_lost_rows_are_bridged_and_pauses_are_not():
    times = np.delete(2e-3 * np.arange(2000), [300, 301, 700])
    times[1500:] += 1.0
    even, notes = make_even(recording(times), NAMES)
    gaps = np.diff(even["time"])
    assert (gaps > 1.5 * 2e-3).sum() == 1
    assert gaps.max() == pytest.approx(1.002, abs=2e-3)
    assert len(even) == pytest.approx(2000, abs=1)
    assert len(notes) == 1


def test_empty_cells_are_lost_rows():
    times = 2e-3 * np.arange(1000)
    position = np.where(np.arange(1000) % 100 == 50, np.nan, 0.1 * times)
    even, notes = make_even(recording(times, position), NAMES)
    assert notes[0] == "10 rows with an empty cell count as lost"
    assert even["lift.position"] == pytest.approx(0.1 * even["time"], abs=1e-12)
    assert len(even) == 1000


def test_a_row_without_a_time_is_a_lost_row():
    times = 2e-3 * np.arange(1000)
    given = recording(times)
    given["time"][500] = np.nan

    even, notes = make_even(given, NAMES)

    assert notes[0] == "1 rows with an empty cell count as lost"
    assert even["time"] == pytest.approx(times)
    assert even["lift.position"] == pytest.approx(0.1 * times)


def test_a_column_that_is_empty_more_often_is_refused():
    times = 2e-3 * np.arange(1000)
    position = np.where(np.arange(1000) % 3 == 0, np.nan, 0.1 * times)
    with pytest.raises(ConfigError, match=r"lift\.position is no number in 334 of 1000 rows"):
        make_even(recording(times, position), NAMES)


def test_a_coarse_clock_is_refined():
    exact = 2e-3 * np.arange(1000)
    coarse = np.floor(exact / 0.01 + 1e-9) * 0.01
    even, notes = make_even(recording(coarse, 0.1 * exact), NAMES)
    assert np.diff(even["time"]) == pytest.approx(2e-3, rel=1e-3)
    assert "steps of 10 ms for rows each 2 ms" in notes[0]


def test_a_clock_that_falls_is_left_for_whoever_refuses_it():
    times = 2e-3 * np.arange(1000)
    times[500:] -= 0.5
    given = recording(times)
    assert make_even(given, NAMES)[0] is given
