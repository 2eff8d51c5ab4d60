"""Profiles against their closed forms."""

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_drivers import MotionProfile
from hil_drivers.motion_profile import Move, shortest_time

# A nanometre at least: near the smallest float, squares have no digits left.
positions = st.one_of(st.just(0.0), st.floats(1e-9, 1.0), st.floats(-1.0, -1e-9))
limits = st.floats(0.01, 10.0)


def test_a_quintic_passes_its_known_points():
    move = Move(0.0, 1.0, 2.0)
    assert move.at(0.0) == (0.0, 0.0, 0.0)
    # s(1/2) = 10/8 - 15/16 + 6/32 = 1/2, s'(1/2) = 15/8 by symmetry the greatest, s''(1/2) = 0.
    assert move.at(1.0) == pytest.approx((0.5, 15 / 8 / 2.0, 0.0), abs=1e-15)
    # s(1/4) = 10/64 - 15/256 + 6/1024 = 106/1024.
    assert move.at(0.5).position == pytest.approx(106 / 1024, rel=1e-14)
    assert move.at(2.0) == (1.0, 0.0, 0.0)
    assert move.at(-1.0) == (0.0, 0.0, 0.0)


@given(positions, positions, limits, st.floats(0.05, 0.95))
def test_speed_and_acceleration_are_derivatives(origin, target, time, fraction):
    move, step = Move(origin, target, time), 1e-5 * time
    now, before, after = (move.at(fraction * time + shift) for shift in (0.0, -step, step))
    # Central differences: relative error of the order of step².
    scale = abs(target - origin) + 1e-9
    assert (after.position - before.position) / (2 * step) == pytest.approx(
        now.speed, abs=1e-5 * scale / time
    )
    assert (after.speed - before.speed) / (2 * step) == pytest.approx(
        now.acceleration, abs=1e-4 * scale / time**2
    )


@given(positions, limits, limits)
def test_the_shortest_time_uses_one_of_the_limits_up(distance, speed, acceleration):
    time = shortest_time(distance, speed, acceleration)
    # Greatest speed at r = 1/2; greatest acceleration at r = (3 - sqrt 3) / 6.
    move = Move(0.0, distance, time)
    greatest_speed = abs(move.at(time / 2).speed)
    greatest_acceleration = abs(move.at(time * (3 - math.sqrt(3)) / 6).acceleration)
    assert greatest_speed <= speed * (1 + 1e-9)
    assert greatest_acceleration <= acceleration * (1 + 1e-9)
    if abs(distance) > 1e-6:
        assert math.isclose(greatest_speed, speed, rel_tol=1e-6) or math.isclose(
            greatest_acceleration, acceleration, rel_tol=1e-6
        )


@pytest.fixture
def profile():
    """0.1 m in 15/8 * 0.1 / 0.15 = 1.25 s, 0.05 m in 0.625 s; the acceleration never limits."""
    return MotionProfile(0.0, [0.1, 0.05], speed=0.15, acceleration=100.0, dwell=0.5)


@pytest.mark.parametrize(
    ("time", "position"),
    [
        (-1.0, 0.0),
        (0.0, 0.0),
        (0.625, 0.05),  # half way
        (1.25, 0.1),
        (1.74, 0.1),  # resting
        (1.75 + 0.3125, 0.075),  # half way back
        (2.375, 0.05),
        (1e6, 0.05),
    ],
)
def test_moves_and_rests_follow_each_other(profile, time, position):
    assert profile.at(time).position == pytest.approx(position, abs=1e-12)


def test_the_duration_ends_with_the_last_rest(profile):
    assert profile.duration == pytest.approx(1.25 + 0.5 + 0.625 + 0.5)


def test_a_repeated_profile_goes_round_between_its_waypoints():
    profile = MotionProfile(
        0.0, [0.1, -0.1], speed=0.15, acceleration=100.0, dwell=0.5, repeat=True
    )
    # To 0.1 and rest: 1.75 s. A round is there and back, 0.2 m each, and two rests: 2 * 3 s.
    for time in (1.75, 2.0, 4.75, 6.5, 7.0):
        for rounds in (1, 2, 1000):
            later = profile.at(time + 6.0 * rounds)
            assert later.position == pytest.approx(profile.at(time).position, abs=1e-9)
    assert profile.at(1.75 + 1.25).position == pytest.approx(0.0, abs=1e-12)


def test_a_round_begins_at_the_first_of_two_equal_waypoints():
    profile = MotionProfile(
        0.0, [0.1, 0.1, -0.1], speed=0.15, acceleration=100.0, dwell=0.0, repeat=True
    )
    # To 0.1: 1.25 s; a round is 0.2 m there and back, 2.5 s each.
    for time, position in ((1.25, 0.1), (3.75, -0.1), (6.25, 0.1), (8.75, -0.1), (7.5, 0.0)):
        assert profile.at(time).position == pytest.approx(position, abs=1e-9)


@pytest.mark.long
@given(st.lists(positions, min_size=1, max_size=4), st.booleans(), st.floats(0.0, 0.2))
def test_the_set_point_never_jumps(waypoints, repeat, dwell):
    profile = MotionProfile(0.3, waypoints, speed=0.5, acceleration=5.0, dwell=dwell, repeat=repeat)
    times = [number * 1e-3 for number in range(-10, int(2.5 * profile.duration * 1e3) + 10)]
    for before, after in pairwise(profile.at(time).position for time in times):
        assert abs(after - before) <= 0.5 * 1e-3 * (1 + 1e-6) + 1e-12


@pytest.mark.parametrize(
    "arguments",
    [
        {"waypoints": []},
        {"waypoints": [math.nan]},
        {"start": math.inf},
        {"speed": 0.0},
        {"acceleration": -1.0},
        {"dwell": -0.1},
        {"speed": math.nan},
    ],
)
def test_what_makes_no_sense_is_refused(arguments):
    sound = {"start": 0.0, "waypoints": [0.1], "speed": 1.0, "acceleration": 1.0, "dwell": 0.0}
    with pytest.raises(ValueError, match="right"):
        MotionProfile(**{**sound, **arguments})
