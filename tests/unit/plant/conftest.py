"""An independent reading of the paper: eqs. (1)-(13) as printed, integrated by Runge-Kutta."""

import math
from typing import NamedTuple

import pytest

from hil_bench.plants.hydraulic_cylinder.model import PlantState, balanced_state, paper_parameters
from hil_bench.plants.hydraulic_cylinder.model.kernel import kernel

_TANH_GAIN = 400.0  # Ruderman 2017, section IV-B


class Printed(NamedTuple):
    """What the printed equations need, in their order."""

    alpha: float
    beta: float
    omega_0: float
    xi: float
    C_d: float
    w: float
    rho: float
    E: float
    P_S: float
    P_T: float
    C_L: float
    A_A: float
    A_B: float
    V_A0: float
    V_B0: float
    m: float
    F_c: float
    F_s: float
    sigma: float
    chi: float
    delta: float
    h: float


@kernel
def dead_zone_saturation(nu, alpha, beta):
    if abs(nu) >= alpha + beta:
        return math.copysign(alpha, nu)
    if abs(nu) < beta:
        return 0.0
    return nu - math.copysign(beta, nu)


@kernel
def root(drop):
    return math.copysign(math.sqrt(abs(drop)), drop)


@kernel
def rates(y, u, F_L, p):
    x, v, P_A, P_B, nu, nu_dot = y
    z = dead_zone_saturation(nu, p.alpha, p.beta)
    K = p.C_d * p.w * math.sqrt(2.0 / p.rho)
    Q_A, Q_B = 0.0, 0.0
    if z > 0.0:
        Q_A = z * K * root(p.P_S - P_A)
        Q_B = -z * K * root(P_B - p.P_T)
    elif z < 0.0:
        Q_A = z * K * root(P_A - p.P_T)
        Q_B = -z * K * root(p.P_S - P_B)
    x_saturated = min(max(x, -p.h), p.h)
    V_A = p.V_A0 + p.A_A * x_saturated
    V_B = p.V_B0 - p.A_B * x_saturated
    stribeck = p.F_c + (p.F_s - p.F_c) * math.exp(-((abs(v) / p.chi) ** p.delta))
    f = math.tanh(_TANH_GAIN * v) * stribeck + p.sigma * v
    return (
        v,
        (P_A * p.A_A - P_B * p.A_B - f - F_L) / p.m,
        p.E / V_A * (Q_A - p.A_A * v - p.C_L * (P_A - P_B)),
        p.E / V_B * (Q_B + p.A_B * v - p.C_L * (P_B - P_A)),
        nu_dot,
        p.omega_0**2 * (u - nu) - 2.0 * p.xi * p.omega_0 * nu_dot,
    )


@kernel
def shifted(y, k, by):
    return (
        y[0] + by * k[0],
        y[1] + by * k[1],
        y[2] + by * k[2],
        y[3] + by * k[3],
        y[4] + by * k[4],
        y[5] + by * k[5],
    )


@kernel
def runge_kutta(y, u, F_L, p, dt, steps):
    for _ in range(steps):
        k1 = rates(y, u, F_L, p)
        a = shifted(y, k1, 0.5 * dt)
        k2 = rates(a, u, F_L, p)
        b = shifted(y, k2, 0.5 * dt)
        k3 = rates(b, u, F_L, p)
        c = shifted(y, k3, dt)
        k4 = rates(c, u, F_L, p)
        y = shifted(shifted(y, k1, dt / 6.0), k2, dt / 3.0)
        y = shifted(shifted(y, k3, dt / 3.0), k4, dt / 6.0)
    return y


def printed(parameters):
    return Printed(**{name: float(getattr(parameters, name)) for name in Printed._fields})


@pytest.fixture
def paper():
    return paper_parameters()


@pytest.fixture
def paper_rates():
    """The right-hand side as printed: rates(state, u, F_L, parameters)."""
    return lambda state, u, F_L, parameters: rates(state[:6], u, F_L, printed(parameters))


@pytest.fixture
def reference():
    """States at 0, 1, 2, ... ms under one set-point per ms, from rest.

    Runge-Kutta of order 4 at 1e-5 s; against 5e-7 s its velocity differs by less than 2e-6 of the
    peak, for bulk moduli from 1e8 to 1e9 Pa.
    """

    def integrate(parameters, setpoints):
        states = [balanced_state(parameters)]
        for u in setpoints:
            y = tuple(float(value) for value in states[-1][:6])
            states.append(
                PlantState(*runge_kutta(y, float(u), 0.0, printed(parameters), 1e-5, 100))
            )
        return states

    return integrate
