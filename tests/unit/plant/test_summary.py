"""Key figures of a cylinder, one by one: flows, forces and frequencies by their formulas."""

import math

import pytest

from hil_bench.bench.configuration import load_config

PRESS = {
    "bore_mm": 63,
    "rod_mm": 36,
    "stroke_mm": 500,
    "rated_flow_l_min": 60,
    "rated_pressure_drop_bar": 5,
    "overlap_percent": 15,
    "frequency_90deg_hz": 40,
    "supply_pressure_bar": 210,
    "tank_pressure_bar": 4,
    "load_mass_kg": 500,
    "load_n": 3000,
    "coulomb_friction_n": 400,
    "viscous_friction_n_s_m": 1200,
    "moving_mass_kg": 20,
    "bulk_modulus_mpa": 1400,
    "end_stop_stiffness_n_mm": 2e5,
}


def facts(**keys):
    axis = load_config(tables={"plant": {"axis1": PRESS | keys}}).axes[0]
    found = axis.kind.summarise(axis, 1000, 50)
    return axis.parameters, {fact.name.strip(): fact for fact in found}


@pytest.mark.parametrize(("word", "sign"), [("extending", 1.0), ("retracting", -1.0)])
def test_a_top_speed_balances_forces_and_flows(word, sign):
    p, found = facts()
    value = {name: fact.value for name, fact in found.items()}
    speed = value[f"top speed {word}"] * 1e-3
    P_A, P_B = (value[f"pressure {port} {word}"] * 1e5 for port in "AB")
    # At such a speed nothing of the Stribeck part of eq. (13) is left.
    friction = sign * (400.0 + 1200.0 * speed)
    assert P_A * p.A_A - P_B * p.A_B == pytest.approx(friction + 3000.0, abs=0.1)
    (fed, P_1), (drained, P_2) = ((p.A_A, P_A), (p.A_B, P_B))[:: int(sign)]
    edge = p.C_d * p.w * math.sqrt(2.0 / p.rho) * p.alpha
    assert fed * speed == pytest.approx(edge * math.sqrt(210e5 - P_1), rel=1e-6)
    assert drained * speed == pytest.approx(edge * math.sqrt(P_2 - 4e5), rel=1e-6)
    assert value[f"flow from the supply {word}"] == pytest.approx(fed * speed * 6e4)
    assert found[f"top speed {word}"].note == "valve wide open, with friction and load"


def test_the_other_figures_follow_from_sizes_and_mass():
    p, found = facts()
    value = {name: fact.value for name, fact in found.items()}

    def swing(x):
        springs = p.A_A**2 / (p.V_A0 + p.A_A * x) + p.A_B**2 / (p.V_B0 - p.A_B * x)
        return math.sqrt(1.4e9 / 520.0 * springs) / (2.0 * math.pi)

    ends = swing(-0.25), swing(0.25)
    top = max(value["top speed extending"], value["top speed retracting"]) * 1e-3
    lowest = value["eigenfrequency, lowest"]
    assert lowest == pytest.approx(min(swing(x * 1e-4) for x in range(-2500, 2501)), rel=1e-6)
    expected = {
        "eigenfrequency, retracted": ends[0],
        "eigenfrequency, mid-stroke": swing(0.0),
        "eigenfrequency, extended": ends[1],
        "limit of a position controller": 4.0 * math.pi * value["damping ratio there"] * lowest,
        "valve at -90 degrees": 40.0,
        "ticks a swing": 1e3 / lowest,
        "steps a swing": 2e4 / max(ends),
        "largest push": 21e3 * p.A_A - 400.0 * p.A_B,
        "largest pull": 21e3 * p.A_B - 400.0 * p.A_A,
        "load at the start": 3.0,
        "moving mass": 520.0,
        "largest acceleration": 21e6 * p.A_A / 520.0,
        "time to top speed, at least": 1e3 * 520.0 * top / (21e6 * p.A_A),
        "energy at the end stop": 260.0 * top**2,
        "depth of impact, at most": 1e3 * top * math.sqrt(520.0 / 2e8),
    }
    assert {name: value[name] for name in expected} == pytest.approx(expected, rel=1e-9)
    rest = value["pressure A at rest"] * p.A_A - value["pressure B at rest"] * p.A_B
    assert rest * 1e5 == pytest.approx(3000.0, abs=0.1)


@pytest.mark.parametrize(
    ("keys", "name", "note"),
    [
        ({"load_n": 90_000}, "top speed extending", "the load holds the piston"),
        ({"compensator_margin_bar": 2}, "top speed extending", "held by the margin of compensator"),
        ({"load_n": -90_000}, "top speed extending", "the load runs ahead of the oil"),
        ({"load_mass_kg": 2e5}, "ticks a swing", "resolved: 4 are needed"),
        ({"load_mass_kg": 0, "moving_mass_kg": 5}, "ticks a swing", "not resolved: 4 are needed"),
        (
            # 60 l/min over 0.5 l/min a bar.
            {
                "supply": "unit",
                "relief_pressure_bar": 210,
                "pump_flow_l_min": 60,
                "relief_gradient_l_min_bar": 0.5,
            },
            "top speed extending",
            "limited by the pump; at the relief valve's setting, P_S rises by up to 120 bar",
        ),
    ],
)
def test_a_note_says_what_limits(keys, name, note):
    assert facts(**keys)[1][name].note.startswith(note)
