"""What of a configuration is hard to believe, and what is refused."""

import math

import pytest
from support.tables import from_text

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


@from_text("keys", "said")
def test_a_value_that_no_machine_has_is_said_with_its_number(load, keys, said):
    assert f"b.toml:plant.axis1.{said}" in find_doubts(load(keys))


@from_text("keys", "said")
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
