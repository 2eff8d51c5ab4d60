"""Compensations by themselves, with 10000 for 100 % so that the numbers can be read.

Moog ACV manual, 7.2.6 to 7.2.8: see `hil_bench.devices.demand_generator`.
"""

import pytest

from hil_bench.devices.demand_generator import (
    CURVE_POINTS,
    DeadBand,
    DeadBandType,
    apply_directional_gain,
    follow_curve,
)

SIDES = {"side_a": 2000, "side_b": 4000, "threshold": 100, "reference": 10000}
JUMP = DeadBand(DeadBandType.JUMP, **SIDES)
CONTINUOUS = DeadBand(DeadBandType.CONTINUOUS, **SIDES)


@pytest.mark.parametrize("dead_band", [JUMP, CONTINUOUS])
@pytest.mark.parametrize(
    ("value", "compensated"),
    [
        (0, 0),
        (100, 2000),  # the step itself, at the threshold
        (-100, -4000),
        # Half way from threshold to 100 % is half way from step to 100 %.
        (5050, 6000),
        (-5050, -7000),
        (10000, 10000),
        (-10000, -10000),
        (12000, 12000),  # beyond 100 % nothing is left to compensate
        (-12000, -12000),
    ],
)
def test_beyond_the_threshold_the_step_is_added(dead_band, value, compensated):
    assert dead_band.compensate(value) == pytest.approx(compensated)


@pytest.mark.parametrize(
    ("value", "jump", "continuous"),
    # Half of the threshold gives nothing, or half of the step.
    [(50, 0, 1000), (-50, 0, -2000), (99, 0, 1980), (-99, 0, -3960)],
)
def test_below_the_threshold_the_types_differ(value, jump, continuous):
    assert JUMP.compensate(value) == jump
    assert CONTINUOUS.compensate(value) == pytest.approx(continuous)


@pytest.mark.parametrize("kind", [DeadBandType.JUMP, DeadBandType.CONTINUOUS])
def test_without_a_threshold_only_zero_stays_zero(kind):
    dead_band = DeadBand(kind, **SIDES | {"threshold": 0})
    assert dead_band.compensate(0) == 0
    assert dead_band.compensate(1) == pytest.approx(2000.8)  # 2000 + 1 * (10000 - 2000) / 10000
    assert dead_band.compensate(-1) == pytest.approx(-4000.6)


def test_a_threshold_of_100_percent_leaves_what_is_above():
    dead_band = DeadBand(DeadBandType.JUMP, **SIDES | {"threshold": 10000})
    assert dead_band.compensate(9999) == 0
    assert dead_band.compensate(10000) == 10000


@pytest.mark.parametrize(
    ("factor", "value", "reduced"),
    # Below 1 the positive side is reduced by it, from 1 on the negative side by its inverse.
    [
        *((0.5, 800, 400), (0.5, -800, -800)),
        *((2.0, 800, 800), (2.0, -800, -400)),
        *((1.0, 800, 800), (1.0, -800, -800), (2.0, 0, 0)),
    ],
)
def test_the_directional_gain_reduces_one_side(factor, value, reduced):
    assert apply_directional_gain(value, factor) == reduced


# Half of the input up to 0, a quarter beyond: points at -16384, -16256, ..., 16384.
BENT = [(-16384 + 128 * n) // (2 if n <= 128 else 4) for n in range(CURVE_POINTS)]


@pytest.mark.parametrize(
    ("value", "bent"),
    [
        *((0, 0), (-16384, -8192), (16384, 4096), (-256, -128), (256, 64)),
        *((64, 16), (-64, -32), (1.0, 0.25)),  # between two points
        (16320, 4080),  # between the last two
        *((-16400, -8192), (-20000, -8192), (20000, 4096)),  # beyond the ends
    ],
)
def test_a_characteristic_is_straight_between_its_points(value, bent):
    assert follow_curve(value, BENT) == pytest.approx(bent)


def test_a_straight_characteristic_changes_nothing():
    straight = range(-16384, 16385, 128)
    for value in (-16384, -16383, -1, 0, 127, 129, 9999.5, 16384):
        assert follow_curve(value, straight) == pytest.approx(value)
