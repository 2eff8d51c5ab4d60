"""Eq. (14) at points worked by hand."""

import math

import numpy as np
import pytest

from hil_bench.abilities.analysis.figures import draw_flow_pressure
from hil_bench.abilities.analysis.operating_point import flow_pressure_curves
from hil_bench.errors import ParameterError


def test_a_curve_starts_at_no_load_and_ends_at_the_supply_pressure(table_1):
    curves = flow_pressure_curves(table_1, orifice_states=[0.0, 1e-3], points=11)

    # K = 0.65 * 0.02 sqrt(2 / 850) = 6.3059e-4; Q = 1e-3 K sqrt(1e7 / 2) = 1.41e-3 m³/s
    assert curves.load_pressure[[0, -1]] == pytest.approx([0.0, 1e7])
    assert curves.flow[1, 0] == pytest.approx(6.3059e-7 * math.sqrt(5e6), rel=1e-5)
    assert curves.flow[1, -1] == 0.0
    assert not curves.flow[0].any()


def test_half_the_flow_is_left_at_three_quarters_of_the_supply(table_1):
    curves = flow_pressure_curves(table_1, orifice_states=[5e-4], points=3)

    assert curves.load_pressure[1] == pytest.approx(7.5e6)
    assert curves.flow[0, 1] == pytest.approx(0.5 * curves.flow[0, 0])


def test_a_negative_opening_is_helped_by_a_positive_load(table_1):
    curves = flow_pressure_curves(table_1, orifice_states=[-1e-3], points=2)

    assert curves.flow[0] == pytest.approx(-6.3059e-7 * np.sqrt([5e6, 1e7]), rel=1e-5)


def test_by_default_the_curves_go_from_closed_to_fully_open(table_1):
    assert flow_pressure_curves(table_1).orifice_states[[0, -1]] == pytest.approx([0.0, 1e-3])


def test_a_figure_of_curves_is_in_bar_and_litres_per_minute(table_1):
    curves = flow_pressure_curves(table_1, orifice_states=[0.0, 1e-3], points=11)
    (place,) = draw_flow_pressure(curves).axes
    assert (place.get_xlabel()[-5:], place.get_ylabel()[-7:]) == ("[bar]", "[l/min]")
    for line, flow in zip(place.lines, curves.flow, strict=False):
        assert line.get_xdata() == pytest.approx(curves.load_pressure / 1e5)
        assert line.get_ydata() == pytest.approx(flow * 60_000.0)


@pytest.mark.parametrize(
    ("states", "points", "message"),
    [
        ([1.1e-3], 10, "within the valve's"),
        ([math.nan], 10, "within the valve's"),
        ([[1e-3]], 10, "in a row"),
        ([1e-3], 1, "needs 2 or more"),
    ],
)
def test_senseless_curves_are_refused(table_1, states, points, message):
    with pytest.raises(ParameterError, match=message):
        flow_pressure_curves(table_1, orifice_states=states, points=points)
