"""What is sought, and what is held."""

from pathlib import Path

import numpy as np
import pytest
from support.machine_record import FULL_OPENING, Machine, random_steps

from hil_bench.abilities.identification.choice import choose, find_sensors, with_hysteresis
from hil_bench.abilities.identification.record import AxisRecord
from hil_bench.abilities.identification.unknowns import KINDS, PROMPT, Sensors, check_names
from hil_bench.bench.configuration import load_config
from hil_bench.devices.measurement.parameters import ChainParameters
from hil_bench.errors import ConfigError

SHEET = """
[plant.axis1]
bore_mm = 63
rod_mm = 36
stroke_mm = 500
rated_flow_l_min = 60
rated_pressure_drop_bar = 5
overlap_percent = 15
frequency_90deg_hz = 40
"""


def test_without_a_data_sheet_all_usual_parameters_are_sought() -> None:
    choice = choose((), PROMPT, [], [])

    assert choice.names == tuple(KINDS)
    assert not choice.held


def test_what_the_data_sheet_says_is_held_and_what_is_typical_is_not(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(SHEET, encoding="utf-8")
    settings = load_config(path).settings

    choice = choose(settings, PROMPT, [], [])
    other = choose(settings, PROMPT, [], ["orifice_width_mm"])

    reason = "from rated_flow_l_min and rated_pressure_drop_bar"
    assert choice.held["orifice_width_mm"].startswith(reason)
    assert "w" not in choice.names
    assert "F_c" in choice.names  # typical only
    assert "w" in other.names


def test_the_user_holds_and_frees() -> None:
    choice = choose((), PROMPT, ["moving_mass_kg"], ["supply_pressure_bar", "pressure_lag_ms"])

    assert "m" not in choice.names
    assert {"P_S", "pressure_lag"} <= set(choice.names)
    assert choice.held == {"moving_mass_kg": "by --fix"}


def test_a_lag_that_the_sensors_have_is_sought() -> None:
    sensors = find_sensors(
        ChainParameters(delay_ns=1_000_000, sampling_period_ns=1_000_000),
        ChainParameters(bandwidth=233.0),
    )

    # half a period old, and 1 / (2 pi 233 Hz)
    assert sensors == pytest.approx((1.5e-3, 0.0, 0.0, 0.683e-3), abs=1e-6)
    names = set(choose((), sensors, [], []).names)
    assert names - set(KINDS) == {"position_delay", "pressure_lag"}
    assert find_sensors(ChainParameters(), None) == Sensors()


@pytest.mark.parametrize(
    ("fix", "free", "complaint"),
    [
        (["mass"], [], "--fix mass: is no unknown; the nearest one is "),
        ([], ["bore_mm"], "--free bore_mm: is no unknown"),
        (["moving_mass_kg"], ["moving_mass_kg"], "--free says the contrary"),
    ],
)
def test_a_choice_with_a_mistake_is_refused(
    fix: list[str], free: list[str], complaint: str
) -> None:
    with pytest.raises(ConfigError, match=complaint):
        choose((), PROMPT, fix, free)


def test_a_gain_of_the_command_needs_a_known_valve() -> None:
    with pytest.raises(ConfigError, match="command_gain is not decidable beside the valve"):
        check_names(["gain", "w"], 1)
    check_names(["gain", "m"], 1)


def test_a_flow_by_recording_takes_two_recordings() -> None:
    with pytest.raises(ConfigError, match="session_flow compares recordings; give two or more"):
        check_names(["w", "session_flow"], 1)
    check_names(["w", "session_flow"], 2)


def test_the_hysteresis_of_the_sensors_counts_as_noise() -> None:
    record = AxisRecord.of(
        Machine().record(random_steps(0.5e-3, 1e-3, 34, 100)), "axis1", FULL_OPENING
    )
    record = record.with_noise(np.array([3e-6, 4e3, np.inf]))

    heard = with_hysteresis(
        record, ChainParameters(hysteresis=8e-6), ChainParameters(hysteresis=6e3)
    )

    # Half the width, and what was there: 3 and 4, 4 and 3 make 5. P_B was not recorded.
    assert heard.noise == pytest.approx([5e-6, 5e3, np.inf])
    assert heard.notes[len(record.notes) :] == (
        "hysteresis counted as noise: 0.004 mm of the position",
        "hysteresis counted as noise: 0.03 bar of the pressures",
    )


def test_sensors_without_hysteresis_leave_the_noise_as_it_is() -> None:
    record = AxisRecord.of(
        Machine().record(random_steps(0.5e-3, 1e-3, 34, 100)), "axis1", FULL_OPENING
    )

    heard = with_hysteresis(record, None, ChainParameters(delay_ns=1000))

    assert list(heard.noise) == list(record.noise)
    assert heard.notes == record.notes
