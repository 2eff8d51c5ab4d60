"""The locus of k G(s) / s against Routh's criterion and the characteristic equation."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hil_bench.abilities.analysis.root_locus import root_locus
from hil_bench.errors import ParameterError


def test_the_critical_gain_is_that_of_routh(table_1):
    locus = root_locus(table_1)

    # Routh on s³ + 2 zeta omega s² + omega² s + k omega² / A: k = 2 zeta omega A = sigma A / m
    assert locus.critical_gain == pytest.approx(2000.0 * 4.85e-3 / 20.0)
    assert locus.critical_gain == pytest.approx(0.485)
    assert locus.critical_frequency == pytest.approx(447.43, abs=0.005)


def test_the_spool_in_the_loop_moves_the_critical_gain(table_1):
    # 0.493 m²/s: worked out independently, from the phase of k G(s) H(s) / s at -180 degrees
    assert root_locus(table_1, with_spool=True).critical_gain == pytest.approx(0.493, abs=0.0005)


@pytest.mark.parametrize("with_spool", [False, True])
def test_at_the_critical_gain_a_pair_lies_on_the_imaginary_axis(table_1, *, with_spool):
    limit = root_locus(table_1, with_spool=with_spool)
    gains = limit.critical_gain * np.array([0.99, 1.0, 1.01])

    real = root_locus(table_1, gains=gains, with_spool=with_spool).poles.real.max(axis=1)

    assert real[0] < -0.1
    assert real[1] == pytest.approx(0.0, abs=1e-6)
    assert real[2] > 0.1


def test_each_pole_solves_the_characteristic_equation(table_1):
    locus = root_locus(table_1, gains=[0.1, 0.7])

    for gain, poles in zip(locus.gains, locus.poles, strict=True):
        G = (1.0 / 4.85e-3) / (
            (poles / table_1.omega_c) ** 2 + 2.0 * table_1.zeta * poles / table_1.omega_c + 1.0
        )
        assert gain * G / poles == pytest.approx(-np.ones(3))


def test_the_branches_start_at_the_open_loops_poles_and_do_not_jump(table_1):
    locus = root_locus(table_1, with_spool=True)

    assert np.sort_complex(locus.poles[0]) == pytest.approx(np.sort_complex(locus.open_loop_poles))
    steps = np.abs(np.diff(locus.poles, axis=0))
    assert steps.max() < 20.0  # rad/s; two branches lie 400 apart


def test_without_damping_any_gain_is_too_much(table_1):
    locus = root_locus(replace(table_1, sigma=0.0), gains=[0.0, 1e-6])

    assert locus.critical_gain == pytest.approx(0.0, abs=1e-12) or math.isinf(locus.critical_gain)
    assert locus.poles[1].real.max() > 0.0


@pytest.mark.parametrize(
    ("gains", "message"),
    [
        ([-1.0], "0 or greater"),
        ([math.nan], "must be finite"),
        ([[1.0]], "in a row"),
        ([1.0, 1.0], "must rise"),
    ],
)
def test_senseless_gains_are_refused(table_1, gains, message):
    with pytest.raises(ParameterError, match=message):
        root_locus(table_1, gains=gains)
