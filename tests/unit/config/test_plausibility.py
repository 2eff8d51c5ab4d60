"""What of a configuration is hard to believe, and what is refused."""

import math

import pytest

from hil_bench import ConfigError, load_config
from hil_bench.bench.configuration.plausibility import MISTAKEN, find_doubts
from hil_bench.plants.hydraulic_cylinder.keys import AXIS_KEYS
from hil_bench.plants.hydraulic_cylinder.resolution import eigenfrequencies


@pytest.fixture
def load(tmp_path, monkeypatch):
    """Return what loads a bench from the keys of its axis, and perhaps of [bench]."""
    monkeypatch.chdir(tmp_path)

    def load_text(keys, bench=""):
        (tmp_path / "b.toml").write_text(f"[bench]\n{bench}\n[plant.axis1]\n{keys}\n")
        return load_config("b.toml")

    return load_text


def test_the_built_in_bench_is_believed():
    assert find_doubts(load_config()) == []


def test_a_mistaken_unit_is_one_of_a_key():
    assert set(MISTAKEN) <= {key.unit.symbol for key in AXIS_KEYS}


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        # 21 000 000 bar of 1e5 Pa each are 2.1e12 Pa.
        (
            "supply_pressure_bar = 21000000",
            (
                "supply_pressure_bar: 21000000 is 2.1 TPa; 5 to 1000 is usual (up to 350 bar in "
                "machines, 1000 in presses and tools); pascal in the bar key?"
            ),
        ),
        # 1100 bar are 110 MPa, and 11 bar if kPa were meant.
        (
            "supply_pressure_bar = 1100",
            (
                "supply_pressure_bar: 1100 is 110 MPa; 5 to 1000 is usual (up to 350 bar in "
                "machines, 1000 in presses and tools); kPa in the bar key?"
            ),
        ),
        # 0.0001 kg are 100 mg.
        (
            "moving_mass_kg = 0.0001\n",
            (
                "moving_mass_kg: 0.0001 is 100 mg; 0.05 to 1000000 is usual (a piston of 10 mm "
                "to a press of 1000 t)"
            ),
        ),
        (
            "bulk_modulus_mpa = 14000\n",
            (
                "bulk_modulus_mpa: 14000 is 14 GPa; 50 to 3000 is usual (oil 1400 to 2000, much "
                "less with air and hoses); bar in the MPa key?"
            ),
        ),
        (
            "stroke_mm = 0.4",
            (
                "stroke_mm: 0.4 is 400 um; 1 to 30000 is usual (a clamp to a telescope); m in the "
                "mm key?"
            ),
        ),
    ],
)
def test_a_value_that_no_machine_has_is_said_with_its_number(load, keys, said):
    assert f"b.toml:plant.axis1.{said}" in find_doubts(load(keys))


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        (
            "bulk_modulus_mpa = 1.4e6",
            (
                "bulk_modulus_mpa: 1400000 is 1.4 TPa; up to 443000 is possible (that of "
                "diamond); kPa in the MPa key?"
            ),
        ),
        (
            "tank_pressure_bar = -5",
            (
                "tank_pressure_bar: -5 is -500 kPa; -1.01325 or more is possible (gauge pressure; "
                "a vacuum is -1.01325 bar)"
            ),
        ),
        ("discharge_coefficient = 3", "discharge_coefficient: 3; up to 1 is possible (1 is an"),
    ],
)
def test_what_nature_does_not_allow_is_refused(load, keys, said):
    with pytest.raises(ConfigError) as error:
        load(keys)
    assert str(error.value).startswith(f"b.toml:plant.axis1.{said}")


def test_an_oscillation_that_the_tick_does_not_show_is_said(load):
    """E (A_A² / V_A + A_B² / V_B) / m = 1.4e9 (0.0050² / 1.2e-3 + 0.0047² / 1.15e-3) / 5 kg."""
    config = load("bulk_modulus_mpa = 1400\nmoving_mass_kg = 5")
    stiffness = 1.4e9 * (0.0050**2 / 1.2e-3 + 0.0047**2 / 1.15e-3)
    expected = math.sqrt(stiffness / 5.0) / (2.0 * math.pi)
    assert eigenfrequencies(config.axes[0])[0] == pytest.approx(expected)
    (doubt, *_) = find_doubts(config)
    assert doubt.startswith(
        f"b.toml:plant.axis1: the cylinder's eigenfrequency is {expected:.0f} Hz at mid-stroke, "
    )
    # A quarter of its period is the right tick.
    right = math.floor(1e6 / (4.0 * expected))
    assert doubt.endswith(f"ticks of tick_us = 1000 a period; {right} us or less resolves it")
    tick = right // 50 * 50
    finer = load("bulk_modulus_mpa = 1400\nmoving_mass_kg = 5", f"tick_us = {tick}")
    assert find_doubts(finer) == []


def test_a_spool_that_the_step_does_not_resolve_is_said(load):
    # 6000 rad/s are 955 Hz: 1.047 ms a period, of which a step of 200 us is more than a twelfth.
    config = load("spool_natural_frequency_rad_s = 6000", "step_us = 200")
    (doubt,) = find_doubts(config)
    assert doubt == (
        "b.toml:plant.axis1: the spool's natural frequency is 955 Hz, 5.2 steps of step_us = 200 "
        "a period; 87 us or less resolves it"
    )
    assert find_doubts(load("spool_natural_frequency_rad_s = 6000")) == []
