"""What identification reads of a recording, and what it refuses."""

import numpy as np
import pytest
from support.machine_record import FULL_OPENING

from hil_bench.abilities.analysis.study import make_table
from hil_bench.abilities.identification.record import (
    AxisRecord,
    _thin,
    estimate_noise,
    join_records,
)
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import Channel

ROWS = 4000


@pytest.fixture
def recording():
    times = 1e-3 * np.arange(ROWS)
    wave = np.sin(2.0 * np.pi * times)
    return make_table(
        {
            Channel("time", "s"): times,
            Channel("lift.position", "m"): 0.05 * wave,
            Channel("lift.P_A", "Pa"): 5e6 + 1e5 * wave,
            Channel("lift.P_B", "Pa"): 5e6 - 1e5 * wave,
            Channel("lift.spool_setpoint", "-"): 0.5 * wave,
        }
    )


def test_setpoints_count_in_full_openings(recording):
    record = AxisRecord.of(recording, "lift", FULL_OPENING)

    assert record.interval == pytest.approx(1e-3)
    assert len(record) == ROWS
    # sin is 1 after a quarter of a second: half of 1.3 mm
    assert record.setpoints[250] == pytest.approx(0.65e-3)
    assert record.times[-1] == pytest.approx(3.999)
    # a row each ms
    assert [record.rows_in(1e-3 * rows) for rows in (0, 9, 10, 11, 500)] == [0, 9, 10, 11, 500]


def test_the_interval_is_that_of_all_rows_where_times_are_rounded(recording):
    """A double at 1.7e9 s goes in steps of 2^-22 s: each row is 0.99993 or 1.00017 ms later."""
    recording["time"] += 1.7e9
    recording["time"][2000:] += 1.0  # a gap is none of them
    found = AxisRecord.of(recording, "lift", FULL_OPENING).interval
    assert found == pytest.approx(1e-3, rel=1e-6)


def test_noise_is_that_which_was_added_whatever_the_motion_does():
    source = np.random.default_rng(3)
    motion = np.abs(np.linspace(-1.0, 1.0, 20_000))

    found = estimate_noise(motion + 2e-6 * source.standard_normal(20_000), floor=1e-9)

    assert found == pytest.approx(2e-6, rel=0.05)


def test_oil_that_rings_is_no_noise():
    # A step of the valve each 150 ms makes 2 bar of ringing at 150 Hz, which dies out within 40 ms,
    # as stiff oil does. The median of third differences finds 8 kPa there.
    source = np.random.default_rng(4)
    since = np.tile(1e-3 * np.arange(150), 200)
    ringing = 2e5 * np.exp(-since / 0.04) * np.sin(2.0 * np.pi * 150.0 * since)

    found = estimate_noise(ringing + 5e3 * source.standard_normal(30_000), floor=1e-9)

    assert found == pytest.approx(5e3, rel=0.1)


@pytest.mark.parametrize("rows", [320, 3000, 30_000])
def test_white_noise_is_found_in_short_records_too(rows):
    source = np.random.default_rng(5)
    found = [estimate_noise(source.standard_normal(rows), floor=1e-9) for _ in range(50)]

    # The quietest tenth of n blocks scatters by some 30 % / sqrt(n).
    assert np.mean(found) == pytest.approx(1.0, rel=0.03 if rows > 1000 else 0.1)
    assert np.std(found) < 0.5 / np.sqrt(rows / 32)


def test_noise_is_at_least_the_rounding_of_the_sensor():
    # uniform rounding errors of a step q have the standard deviation q / sqrt(12)
    values = np.repeat(1e-5 * np.arange(100.0), 50)

    assert estimate_noise(values, floor=1e-9) == pytest.approx(1e-5 / np.sqrt(12.0))


def test_motion_that_never_stops_is_no_rounding():
    # 40 um from row to row; the noise is 2 um.
    source = np.random.default_rng(6)
    motion = 4e-5 * np.arange(4000.0)

    found = estimate_noise(motion + 2e-6 * source.standard_normal(4000), floor=1e-9)

    assert found == pytest.approx(2e-6, rel=0.1)


def test_noise_is_at_least_the_floor():
    assert estimate_noise(np.zeros(100), floor=3e-7) == 3e-7


def test_nothing_reaches_across_a_gap(recording):
    recording["time"][1000:] += 0.02
    recording["time"][1100:] += 0.5e-3  # half a row is a gap, too

    record = AxisRecord.of(recording, "lift", FULL_OPENING)

    # what lies between two gaps at 0.1 s from each other is too short to serve
    assert record.stretches == (range(1000), range(1100, 4000))


def test_motion_one_way_is_told_from_motion_both_ways(recording):
    both = AxisRecord.of(recording, "lift", FULL_OPENING)
    noise = 2e-6 * np.random.default_rng(2).standard_normal(ROWS)
    recording["lift.position"] = np.linspace(-0.1, 0.1, ROWS) + noise
    one = AxisRecord.of(recording, "lift", FULL_OPENING)

    assert (both.moves_both_ways, one.moves_both_ways) == (True, False)


def _lack(recording):
    names = [name for name in recording.dtype.names or () if ".P_" not in name]
    return recording[names]


def _stop(recording):
    recording["lift.P_A"] = 5e6
    return recording


def _turn_back(recording):
    recording["time"][100] = 0.05
    return recording


def _break(recording):
    recording["lift.P_A"][1500:1503] = np.nan
    return recording


def _gaps(recording):
    for row in range(100, ROWS, 100):
        recording["time"][row:] += 0.02
    return recording


def _rest(recording):
    recording["lift.position"] *= 1e-3
    return recording


def _slow(recording):
    recording["time"] *= 20.0
    return recording


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (_lack, "lacks lift.P_A and lift.P_B, which identification needs; it has lift"),
        (_stop, "lift.P_A is constant at 5e+06; leave a column out that measures nothing"),
        (_turn_back, "time does not rise after 0.099 s: the next row has 0.05 s"),
        (_break, "lift.P_A is no number in 3 rows, first at 1.5 s"),
        (_gaps, "39 gaps in time, the first at 0.099 s, of 21 ms; 0 s of it are even"),
        (_rest, "moves by 0.1 mm"),
        (_slow, "a row each 20 ms; give 10 ms or less"),
        (lambda recording: recording[:200], "spans 0.199 s in 200 rows; a stroke takes 0.3 s"),
        (lambda recording: recording[:0], "spans 0 s in 0 rows"),
        (lambda recording: recording[:1001:1000], "a row each 1000 ms"),
        (lambda recording: recording[::-1], "-3.999 s"),
    ],
)
def test_a_recording_that_cannot_serve_is_refused(recording, change, complaint):
    with pytest.raises(ConfigError) as error:
        AxisRecord.of(change(recording), "lift", FULL_OPENING)

    assert complaint in str(error.value)
    assert "\n" not in str(error.value)


def test_three_seconds_of_all_recordings_together_are_enough(recording):
    short, rest = (AxisRecord.of(recording[:rows], "lift", FULL_OPENING) for rows in (1200, 1801))

    both = join_records([short, rest])
    assert len(both) == 3001
    assert [both.session_of(row) for row in (0, 1199, 1200, 3000)] == [0, 0, 1, 1]
    with pytest.raises(ConfigError, match=r"recordings span together 2\.4 s; 3 s or more"):
        join_records([short, short])
    with pytest.raises(ConfigError, match=r"the recording spans 1\.2 s; 3 s or more"):
        join_records([short])


def test_times_that_are_rounded_up_to_10_ms_are_taken(recording):
    tenth = recording[::10].copy()
    tenth["time"] = np.arange(len(tenth)) * 0.01 * (1.0 + 1e-9)
    assert AxisRecord.of(tenth, "lift", FULL_OPENING).interval > 0.01


def test_a_wrong_axis_is_told_which_there_are(recording):
    with pytest.raises(ConfigError, match=r"lacks swing\.position, .*; it has lift"):
        AxisRecord.of(recording, "swing", FULL_OPENING)


@pytest.mark.parametrize("factor", [1, 2, 3, 7])
def test_a_thinned_record_has_the_mean_set_point_of_the_rows_before_each(recording, factor):
    recording["lift.spool_setpoint"] = np.random.default_rng(7).uniform(-1.0, 1.0, ROWS)
    record = AxisRecord.of(recording, "lift", FULL_OPENING)
    thin = record.thinned(factor)

    assert thin.times.tolist() == record.times[::factor].tolist()
    assert thin.measured.tolist() == record.measured[::factor].tolist()
    assert thin.clipped.shape == thin.measured.shape
    means = [
        sum(record.setpoints[row - factor + 1 : row + 1]) / factor
        for row in range(factor, ROWS, factor)
    ]
    assert thin.setpoints == pytest.approx([record.setpoints[0], *means])
    assert thin.interval == pytest.approx(1e-3 * factor)
    count = len(thin)
    assert (thin.stretches, thin.sessions[0].rows) == ((range(count),), range(count))


@pytest.mark.parametrize("rows", [range(10), range(7, 20), range(9, 19), range(1, 3)])
def test_of_a_stretch_every_third_row_is_left(rows):
    assert list(_thin(rows, 3)) == [row for row in range(10) if 3 * row in rows]
