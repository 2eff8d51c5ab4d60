"""Ramps and trapezoids: at 100 inc/s² 50 inc/s are reached after 0.5 s and 12.5 inc."""

from itertools import pairwise

import pytest

from hil_bench.abilities.drive.motion import Motion

DT = 0.001


def test_a_ramp_reaches_its_velocity_in_time():
    motion = Motion()
    for _ in range(500):
        motion.ramp_to(50.0, 100.0, 200.0, DT)
    assert motion.velocity == pytest.approx(50.0)
    assert motion.position == pytest.approx(12.5, rel=0.01)
    for _ in range(250):
        motion.ramp_to(0.0, 100.0, 200.0, DT)
    assert motion.velocity == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("target", [1.0, 100.0, -100.0])
def test_a_trapezoid_ends_at_its_target_within_its_limits(target):
    motion = Motion()
    ticks, fastest, speeds = 0, 0.0, [0.0]
    while not motion.move_to(target, 50.0, 100.0, 200.0, DT):
        ticks += 1
        fastest = max(fastest, abs(motion.velocity))
        speeds.append(motion.velocity)
        assert abs(motion.position) <= abs(target) + 1e-3
        assert ticks < 10_000
    changes = [abs(b - a) / DT for a, b in pairwise(speeds)]
    assert max(changes) <= 200.0 + 1e-6
    assert fastest <= 50.0 + 1e-9
    assert motion.position == target
    assert motion.velocity == 0.0


def test_the_time_of_a_long_way():
    # 0.5 s up (12.5), 0.25 s down (6.25), the rest of 100 at 50: 1.625 s; 2.375 s in all.
    motion = Motion()
    ticks = 0
    while not motion.move_to(100.0, 50.0, 100.0, 200.0, DT):
        ticks += 1
    assert ticks * DT == pytest.approx(2.375, abs=0.02)


def test_a_cyclic_target_is_reached_within_its_period_and_not_passed():
    motion = Motion()
    for _ in range(10):
        motion.follow(20.0, 20.0 / 0.010, DT)
    assert motion.position == pytest.approx(20.0)
    motion.follow(20.0, 2000.0, DT)
    assert motion.position == 20.0
    assert motion.velocity == 0.0
