import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bench.plants.hydraulic_cylinder.model.orifice import linearise_flow, port_flow

K, P_S, P_T = 6.3059e-4, 1e7, 2e5
PRINTED = (K, P_S, P_T, 0.0, 1.0)
CLAMPED = (K, P_S, P_T, 0.0, 0.0)
LAMINAR = (K, P_S, P_T, 300.0**2, 1.0)

openings = st.floats(1e-6, 1e-3)
pressures = st.floats(-1e7, 3e7)


@pytest.mark.parametrize(
    ("z", "P_A", "P_B", "Q_A", "Q_B"),
    [
        # z > 0: z K sqrt(P_S - P_A) into A, z K sqrt(P_B - P_T) out of B
        (1e-3, 6e6, 4.2e6, 1e-3 * K * 2000.0, -1e-3 * K * 2000.0),
        # z < 0: out of A to the tank, from the supply into B
        (-1e-3, 4.2e6, 6e6, -1e-3 * K * 2000.0, 1e-3 * K * 2000.0),
        (0.0, 4.2e6, 6e6, 0.0, 0.0),
        # overload: the pressure drop is negative and the flow turns round
        (1e-3, P_S + 4e6, P_T - 4e6, -1e-3 * K * 2000.0, 1e-3 * K * 2000.0),
        (-1e-3, P_T - 4e6, P_S + 4e6, 1e-3 * K * 2000.0, -1e-3 * K * 2000.0),
    ],
)
def test_flows_as_printed(z, P_A, P_B, Q_A, Q_B):
    assert port_flow(z, P_A, PRINTED) == pytest.approx(Q_A, rel=1e-12)
    assert port_flow(-z, P_B, PRINTED) == pytest.approx(Q_B, rel=1e-12)


def test_clamped_root_stops_the_flow():
    assert port_flow(1e-3, P_S + 1.0, CLAMPED) == 0.0
    assert port_flow(-1e-3, P_T - 1.0, CLAMPED) == 0.0
    assert port_flow(1e-3, P_S - 4e6, CLAMPED) == port_flow(1e-3, P_S - 4e6, PRINTED)


@pytest.mark.parametrize("orifice", [PRINTED, CLAMPED, LAMINAR])
def test_no_drop_no_flow(orifice):
    assert port_flow(1e-3, P_S, orifice) == 0.0


def test_laminar_transition():
    # dp / (dp² + p_tr²)^(1/4): linear with 1 / sqrt(p_tr) well below, the root well above.
    small = port_flow(1e-3, P_S - 0.3, LAMINAR)
    assert small == pytest.approx(1e-3 * K * 0.3 / math.sqrt(300.0), rel=1e-6)
    large = port_flow(1e-3, P_S - 1e6, LAMINAR)
    assert large == pytest.approx(1e-3 * K * 1e3, rel=1e-7)


@given(opening=openings, pressure=pressures, sign=st.sampled_from([-1.0, 1.0]))
def test_tangent_and_secant(opening, pressure, sign):
    opening *= sign
    flow, secant, tangent = linearise_flow(opening, pressure, LAMINAR)
    step = 1e-2
    rise = port_flow(opening, pressure + step, LAMINAR) - port_flow(
        opening, pressure - step, LAMINAR
    )
    drop = P_S - pressure if opening > 0.0 else pressure - P_T
    # A central difference over 2e-2 Pa of flows known to 1e-16 of the largest, 2e-3 m³/s.
    assert -rise / (2.0 * step) == pytest.approx(tangent, rel=1e-5, abs=1e-16)
    assert abs(flow) == pytest.approx(secant * abs(drop), rel=1e-12)
    assert 0.0 <= tangent <= secant * (1.0 + 1e-12)


@given(opening=openings, drop=st.floats(0.0, 1e7))
def test_flow_turns_round_with_the_drop(opening, drop):
    forward = port_flow(opening, P_S - drop, LAMINAR)
    backward = port_flow(opening, P_S + drop, LAMINAR)
    assert forward == pytest.approx(-backward, rel=1e-6, abs=1e-18)
    assert forward >= 0.0
