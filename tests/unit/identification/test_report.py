"""An identification as text, as JSON and as a table of `bench.toml`."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hil_bench.abilities.identification.approach import Rival
from hil_bench.abilities.identification.identify import Estimate, Identification
from hil_bench.abilities.identification.record import AxisRecord
from hil_bench.abilities.identification.report import (
    find_misses,
    is_explained,
    summarise,
    to_json,
    to_toml,
)
from hil_bench.abilities.identification.trial import Run, Trial
from hil_bench.abilities.identification.unknowns import PROMPT
from hil_bench.bench.configuration import load_config
from hil_bench.plants.hydraulic_cylinder.model import paper_parameters

TABLE_1 = paper_parameters()
ESTIMATES = (
    Estimate("beta", 2.51234e-4, 1.2e-7, (2.50999e-4, 2.51469e-4), is_told=True),
    Estimate("C_L", 0.0, 1e-15, (0.0, 1.96e-15), is_told=True),
    Estimate("E", 1.2345e9, 2.2e6, (1.2302e9, 1.2388e9), is_told=True),
    Estimate("chi", 0.02, 0.05, (-0.078, 0.118), is_told=False),
)


def make(residual: float = 0.9, pressure: float = 1.0) -> Identification:
    """Return what might have been found, on a record of 10 rows.

    Args:
        residual: of the position where nothing was fitted, as a multiple of its noise.
        pressure: of P_A, likewise.
    """
    rows = np.arange(8, 10)
    return Identification(
        record=AxisRecord(
            axis="lift",
            times=1e-3 * np.arange(10),
            stretches=(range(10),),
            interval=1e-3,
            full_opening=1.3e-3,
            setpoints=np.zeros(10),
            measured=np.zeros((10, 3)),
            spool=None,
            noise=np.array([2e-6, 5e3, 5e3]),
        ),
        known=TABLE_1,
        parameters=replace(TABLE_1, beta=2.51234e-4, E=1.2345e9),
        sensors=PROMPT,
        offsets=np.array([[2e4, 100.0]]),
        offset_deviations=np.array([[300.0, 300.0]]),
        estimates=ESTIMATES,
        correlations=np.eye(len(ESTIMATES)),
        residual=np.array([1.01, 1.0, 1.0]),
        is_reached=True,
        is_white=True,
        rivals=(),
        pieces=12,
        left_out=1,
        trial=Trial(
            rows=rows[np.newaxis],
            model=np.zeros((1, 2, 3)),
            residual=np.array([residual, pressure, 1.0]),
            runs=(Run(rows, np.full((2, 3), 1e-3)),),
        ),
    )


def test_the_file_is_a_table_that_bench_toml_takes(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(to_toml(make(), "run.csv"), encoding="utf-8")

    (read,) = load_config(path).axes

    assert read.name == "lift"
    assert read.parameters.beta == pytest.approx(2.51234e-4, abs=1e-8)
    assert read.parameters.E == pytest.approx(1.2345e9, rel=1e-4)
    assert read.parameters.chi == TABLE_1.chi


def test_the_file_says_what_it_does_not_hold_and_which_opening_was_meant() -> None:
    text = to_toml(make(), "run.csv")

    assert "stribeck_velocity_mm_s" not in text
    assert "full_opening_mm = 1.3\n" in text


def test_the_table_has_two_uncertain_digits() -> None:
    lines = {line.split()[0]: line.split()[1:] for line in summarise(make()).splitlines() if line}

    # 0.251234 mm +- 0.00012 mm, in the keys' units
    assert lines["spool_overlap_mm"] == ["0.25123", "0.00012", "0.25100", "0.25147", "0.3"]
    assert lines["bulk_modulus_mpa"] == ["1234.5", "2.2", "1230.2", "1238.8", "100"]


def test_what_is_not_told_comes_with_what_would_tell_it() -> None:
    text = summarise(make())

    (line,) = [line for line in text.splitlines() if line.startswith("stribeck")]
    assert "uncertain by 50 mm/s; wanted: velocities below" in line
    assert "P_A reads +0.200 +- 0.003 bar off" in text
    assert "P_B reads" not in text
    assert "1 left out" in text
    assert "position 1 mm rms" in text  # 1 mm beside a record of zeros


def test_residuals_that_are_not_noise_come_with_a_warning() -> None:
    texts = [
        summarise(replace(make(), residual=np.array([1.0, 1.0, largest]))) for largest in (1.5, 1.6)
    ]

    assert ["side minimum" in text for text in texts] == [False, True]


def test_a_record_of_one_direction_comes_with_a_warning() -> None:
    found = make()
    there = np.linspace(-0.1, 0.1, 100)
    back = np.concatenate([there, there[::-1]])
    lines = [
        summarise(
            replace(
                found,
                record=replace(
                    found.record, stretches=(range(len(way)),), measured=np.column_stack([way] * 3)
                ),
            )
        )
        for way in (there, back)
    ]

    assert ["one way only" in line for line in lines] == [True, False]


def test_a_model_that_does_not_follow_the_record_is_named() -> None:
    assert is_explained(make(residual=3.0))
    assert not is_explained(make(residual=3.1))
    # 3.1 times 2 um
    assert (
        "NOT explain this record, do not use the parameters: it misses\n"
        "  position by 6.2 um rms, 3.1 times its noise, in the trial\n"
    ) in summarise(make(residual=3.1))
    assert "do not use these values" in to_toml(make(residual=3.1), "run.csv")
    assert "do not use" not in to_toml(make(), "run.csv")


def test_pressures_that_miss_by_five_times_the_noise_are_not_explained() -> None:
    found = make(pressure=5.0)

    assert not is_explained(found)
    # 5 times 5 kPa
    assert "P_A by 0.25 bar rms, 5 times its noise, in the trial" in summarise(found)


def test_a_fit_that_misses_a_signal_is_not_explained() -> None:
    found = replace(make(), residual=np.array([1.0, 1.0, 3.2]))

    assert not is_explained(found)
    assert "P_B by 0.16 bar rms, 3.2 times its noise, in the fit" in summarise(found)


def test_a_fit_short_of_its_optimum_says_so() -> None:
    assert "did NOT reach its optimum" in summarise(replace(make(), is_reached=False))
    assert "did NOT reach" not in summarise(make())
    near, far = (
        summarise(replace(make(), is_reached=False, decrement=short)) for short in (0.03, 0.11)
    )
    assert "ended 0.03 standard deviations short of its optimum" in near
    assert "did NOT reach" not in near
    assert "did NOT reach its optimum" in far


def test_coloured_residuals_come_with_what_the_intervals_hold_for() -> None:
    assert "not white noise" in summarise(replace(make(), is_white=False))


def test_starts_that_ended_elsewhere_are_named() -> None:
    apart = {"E": 41.0, "F_c": 3.5, "m": 12.0, "chi": 4.0}
    worse, alike = (
        summarise(replace(make(), rivals=(Rival(residual, apart),))) for residual in (2.5, 1.01)
    )

    assert "with residuals of 2.5 times the noise (1 here)" in worse
    assert "bulk_modulus_mpa by 41, moving_mass_kg by 12" in worse
    assert "side minimum" in worse
    assert "fits both about equally well" in alike


def test_programs_read_the_keys_and_units_of_bench_toml() -> None:
    content = to_json(make())

    assert content["parameters"]["bulk_modulus_mpa"] == {
        "is_told": True,
        "value": pytest.approx(1234.5),
        "standard_deviation": pytest.approx(2.2),
        "interval_95": pytest.approx([1230.2, 1238.8]),
        "configured": pytest.approx(100.0),
        "unit": "MPa",
    }
    assert content["trial_residual"]["position"] == 0.9
    (session,) = content["recordings"]
    assert session["pressure_offsets_bar"] == pytest.approx([0.2, 0.001])
    assert session["signals"] == ["position", "P_A", "P_B"]
    assert content["fit_residual"]["position"] == 1.01
    assert content["is_converged"]


def test_an_offset_that_no_sensor_has_is_no_explanation() -> None:
    found = replace(make(), offsets=np.array([[-6.2e5, 100.0]]))

    (miss,) = find_misses(found)

    assert miss == "P_A, which fits only if its sensor reads -6.2 bar off"
    assert not is_explained(found)
    assert "as with a supply" not in summarise(found)


def test_pressures_that_are_off_alike_stand_for_another_supply() -> None:
    """At rest both pressures are half of the supply: both off by 7.5 bar are 15 bar of it."""
    found = replace(make(), offsets=np.array([[-7.2e5, -7.8e5]]))

    assert "as with a supply of 85 bar; --free supply_pressure_bar" in summarise(found)


def test_several_recordings_that_are_not_explained_may_have_drifted() -> None:
    found = make(residual=3.1)
    both = found.record.sessions * 2
    several = replace(found, record=replace(found.record, sessions=both), offsets=np.zeros((2, 2)))
    several = replace(several, offset_deviations=np.ones((2, 2)))

    assert "--free session_flow" in summarise(several)
    assert "--free session_flow" not in summarise(found)
    told = replace(several, flows=np.array([1.0, 0.98]), flow_deviations=np.array([0.0, 1e-4]))
    assert "the valve passes 0.9800 +- 0.0001" in summarise(told)
    assert "--free session_flow" not in summarise(told)
