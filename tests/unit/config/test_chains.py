"""The tables [nodes.NAME.chain]: units, presets, and what does not go together."""

from pathlib import Path

import pytest
from support.tables import from_text

from hil_bench.bench.configuration import Origin, load_config
from hil_bench.devices.kinds.bindings import (
    CHAIN_KEYS,
    PRESETS,
    PositionPreset,
    PressurePreset,
    preset_chain,
)
from hil_bench.devices.measurement.low_pass import ChainParameters, OverRange
from hil_bench.errors import ConfigError

ROOT = Path(__file__).parents[3]
VALVE = '[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\n'
PRESSURE = '[nodes.p]\nprofile = "pressure_404"\nsource = "P_A"\nnode_id = 2\n[nodes.p.chain]\n'
POSITION = '[nodes.x]\nprofile = "encoder_406"\nnode_id = 3\n[nodes.x.chain]\n'


def chain(write, text):
    return load_config(write(VALVE + text)).nodes[1].chain


def test_the_built_in_sensors_are_ideal():
    assert all(node.chain.is_ideal for node in load_config().nodes[1:])


def test_an_empty_chain_is_ideal(write):
    assert chain(write, PRESSURE).is_ideal
    assert chain(write, POSITION).is_ideal


def test_the_values_of_a_pressure_come_in_si(write):
    parameters = chain(
        write,
        PRESSURE
        + """
        hysteresis_bar = 0.5
        offset_error_bar = -0.25
        gain_error_percent = 0.1
        offset_drift_bar_k = 0.02
        gain_drift_ppm_k = 80
        warming_s_k = [[0, 0], [60, 20]]
        bandwidth_hz = 233
        filter_order = 2
        damping_ratio = 0.5
        sampling_period_us = 1500
        sampling_phase_us = 250
        noise_density_bar_rthz = 0.001
        noise_rms_bar = 0.04
        resolution_bar = 0.01
        range_bar = [-10, 275]
        over_range = "invalid"
        delay_us = 500
        """,
    )
    assert parameters == ChainParameters(
        hysteresis=0.5e5,
        offset_error=-0.25e5,
        gain_error=0.001,
        offset_drift=2000.0,
        gain_drift=pytest.approx(80e-6),
        temperature=((0.0, 0.0), (60.0, 20.0)),
        bandwidth=233.0,
        order=2,
        damping_ratio=0.5,
        sampling_period_ns=1_500_000,
        sampling_phase_ns=250_000,
        noise_density=100.0,
        noise_rms=4000.0,
        resolution=1000.0,
        range=(-10e5, 275e5),
        over_range=OverRange.INVALID,
        delay_ns=500_000,
    )


def test_the_values_of_a_position_come_in_si(write):
    text = (
        "hysteresis_um = 4\noffset_error_mm = 0.1\noffset_drift_um_k = 3\nnoise_rms_um = 2\n"
        "noise_density_um_rthz = 0.5\nbandwidth_hz = 100\nresolution_um = 1\n"
        "range_mm = [-150, 200]\nspeed_window_us = 10000\n"
    )
    parameters = chain(write, POSITION + text)
    expected = {
        "hysteresis": 4e-6,
        "offset_error": 1e-4,
        "offset_drift": 3e-6,
        "noise_rms": 2e-6,
        "noise_density": 0.5e-6,
        "bandwidth": 100.0,
        "resolution": 1e-6,
        "speed_window_ns": 10_000_000,
    }
    assert {name: getattr(parameters, name) for name in expected} == pytest.approx(expected)
    assert parameters.range == pytest.approx((-0.15, 0.2))


def test_a_preset_sets_defaults_and_what_is_given_wins(write):
    text = 'preset = "class_0.25_250_bar"\nnoise_rms_bar = 0.0\n'
    config = load_config(write(VALVE + PRESSURE + text))

    parameters = config.nodes[1].chain
    assert (parameters.bandwidth, parameters.noise_rms) == (233.0, 0.0)
    origins = {
        setting.key.name: setting.origin
        for setting in config.settings
        if setting.table == "nodes.p.chain"
    }
    assert origins["bandwidth_hz"] is Origin.DEFAULT
    assert origins["noise_rms_bar"] is Origin.FILE


def test_the_transducer_of_class_0_25_is_of_its_class():
    """HYDAC HDA 4700: at most 0.25 % of the span of 250 bar, hysteresis included."""
    parameters = preset_chain("Pa", PressurePreset.CLASS_025_250_BAR)
    span = 250e5
    worst = parameters.offset_error + parameters.gain_error * span + parameters.hysteresis / 2
    assert worst == pytest.approx(0.0025 * span)


def test_the_magnetostrictive_sensor_has_its_resolution():
    parameters = preset_chain("m", PositionPreset.MAGNETOSTRICTIVE_1_UM)
    assert parameters.resolution == pytest.approx(1e-6)
    assert parameters.hysteresis == pytest.approx(4e-6)


@pytest.mark.parametrize("unit", CHAIN_KEYS)
def test_a_preset_has_no_key_that_is_not_there(unit):
    names = {key.name for key in CHAIN_KEYS[unit]}
    (preset_key,) = (key for key in CHAIN_KEYS[unit] if key.name == "preset")
    for preset in type(preset_key.default):
        assert PRESETS[preset].keys() <= names


@from_text("text", "message")
def test_a_wrong_value_is_told(write, text, message):
    text = text if text.startswith(VALVE) else VALVE + text
    with pytest.raises(ConfigError) as caught:
        load_config(write(text))
    assert str(caught.value) == f"bench.toml:{message}"


@from_text("text", "message")
def test_values_that_do_not_go_together_are_told(write, text, message):
    with pytest.raises(ConfigError) as caught:
        load_config(write(VALVE + PRESSURE + text))
    assert str(caught.value) == f"bench.toml:nodes.p.chain.{message}"


IO = """
[nodes.io]
eds = "io.eds"
node_id = 9
[nodes.io.objects]
"""


def bound(write, binding):
    """Return the chain of the first object that is bound in an EDS file without a profile."""
    eds = ROOT / "device_profiles" / "imitations" / "analogue_io_401.eds"
    path = write(f'{VALVE}{IO}"0x6401.01" = {{ {binding} }}\n')
    path.with_name("io.eds").write_text(eds.read_text(encoding="utf-8"), encoding="utf-8")
    return load_config(path).nodes[1].sources[0].chain


def test_a_bound_object_is_ideal_without_a_chain(write):
    assert bound(write, 'source = "axis1.P_A"').is_ideal


def test_a_bound_object_may_have_the_chain_of_its_quantity(write):
    pressure = bound(write, 'source = "axis1.P_B", chain = { noise_rms_bar = 0.5 }')
    position = bound(
        write, 'source = "axis1.position", chain = { preset = "magnetostrictive_1_um" }'
    )
    assert pressure.noise_rms == pytest.approx(0.5e5)
    assert position.resolution == pytest.approx(1e-6)


@from_text("binding", "message")
def test_a_wrong_chain_of_a_bound_object_is_told(write, binding, message):
    with pytest.raises(ConfigError) as caught:
        bound(write, binding)
    place, _, told = str(caught.value).partition(": ")
    assert place.startswith("bench.toml:nodes.io.objects.0x6401.01.chain")
    assert told == message
