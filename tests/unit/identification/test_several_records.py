"""Records that belong together, each with one pressure only."""

from dataclasses import replace

import numpy as np
import pytest
from support.machine_record import FULL_OPENING, Machine, random_steps

from hil_bench.abilities.identification.identify import Identification, identify
from hil_bench.abilities.identification.record import AxisRecord, join_records
from hil_bench.abilities.identification.report import summarise, to_json
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import Recording
from hil_bench.plants.hydraulic_cylinder.model import PlantOptions, paper_parameters

STEP = 1e-4
MACHINE = replace(paper_parameters(), w=0.022, E=1.2e8, F_c=500.0, m=24.0)
SHORT = random_steps(0.5e-3, 1e-3, 34, 100)


def without(recording: Recording, *names: str) -> Recording:
    left = [name for name in recording.dtype.names or () if name.rpartition(".")[2] not in names]
    return recording[left]


def read(recording: Recording, name: str) -> AxisRecord:
    return AxisRecord.of(recording, "axis1", FULL_OPENING, name)


@pytest.fixture(scope="module")
def found() -> Identification:
    """Of P_A in one run, with a sensor that is 0.2 bar off, and of P_B in the next."""
    first = Machine(parameters=MACHINE, offset=2e4).record(SHORT)
    second = Machine(parameters=MACHINE).record(random_steps(0.4e-3, 1.1e-3, 34, 100)[::-1])
    record = join_records([read(without(first, "P_B"), "a"), read(without(second, "P_A"), "b")])
    names = ("w", "E", "F_c", "m")
    return identify(
        record, paper_parameters(), PlantOptions.bench(), step=STEP, names=names, starts=3
    )


@pytest.mark.parametrize("name", ["w", "E", "F_c", "m"])
def test_one_pressure_a_run_tells_the_parameters(found: Identification, name: str) -> None:
    (estimate,) = [estimate for estimate in found.told if estimate.name == name]

    assert estimate.value == pytest.approx(getattr(MACHINE, name), rel=0.01)
    assert abs(estimate.value - getattr(MACHINE, name)) < 5.0 * estimate.deviation


def test_each_record_has_offsets_of_its_own(found: Identification) -> None:
    # 0.2 bar on P_A of the first; what no sensor measured is expected within 1 bar
    assert found.offsets[0, 0] == pytest.approx(2e4, abs=3e3)
    assert found.offsets[1, 1] == pytest.approx(0.0, abs=3e3)
    assert found.offset_deviations[0, 1] == pytest.approx(1e5, rel=0.1)


def test_what_is_left_is_noise_in_every_signal(found: Identification) -> None:
    assert found.residual == pytest.approx(1.0, abs=0.2)
    assert np.all(found.trial.residual < 1.3)


def test_the_model_shows_the_pressure_that_was_not_recorded(found: Identification) -> None:
    whole = Machine(parameters=MACHINE).record(SHORT)
    run = found.trial.runs[0]

    # P_B of the first run, from which it is missing
    assert run.model[:, 2] == pytest.approx(whole["axis1.P_B"][run.rows], abs=1e5)


@pytest.mark.long
def test_a_flow_that_drifts_between_two_recordings_is_told() -> None:
    """2 % less in the second; w is that of the first."""
    drifted = replace(MACHINE, w=0.98 * MACHINE.w)
    first = Machine(parameters=MACHINE).record(SHORT)
    second = Machine(parameters=drifted).record(random_steps(0.4e-3, 1.1e-3, 34, 100)[::-1])
    record = join_records([read(first, "a"), read(second, "b")])
    names = ("w", "E", "F_c", "m", "session_flow")

    found = identify(
        record, paper_parameters(), PlantOptions.bench(), step=STEP, names=names, starts=1
    )

    assert found.flows is not None
    assert found.flow_deviations is not None
    assert abs(found.flows[1] - 0.98) < 4.0 * found.flow_deviations[1] < 0.002
    assert found.parameters.w == pytest.approx(0.022, rel=1e-3)
    assert found.residual == pytest.approx(1.0, abs=0.2)
    assert "b: the valve passes 0.98" in summarise(found)
    assert to_json(found)["recordings"][1]["flow_factor"] == pytest.approx(0.98, abs=1e-3)
    assert [one.name for one in found.estimates] == ["w", "E", "F_c", "m"]


def test_the_report_says_what_each_record_gives(found: Identification) -> None:
    text, content = summarise(found), to_json(found)

    assert "a: 3.4 s, position, P_A\nb: 3.4 s, position, P_B" in text
    assert "P_A reads +0.2" in text
    assert "bar off in a" in text
    assert [entry["signals"] for entry in content["recordings"]] == [
        ["position", "P_A"],
        ["position", "P_B"],
    ]


def test_nothing_reaches_from_one_record_into_the_next() -> None:
    recording = Machine().record(SHORT)
    record = join_records([read(recording, "a"), read(recording, "b")])

    assert record.stretches == (range(3400), range(3400, 6800))
    assert [session.rows for session in record.sessions] == [range(3400), range(3400, 6800)]
    assert record.session_of(np.array([0, 3399, 3400, 6799])).tolist() == [0, 0, 1, 1]


def test_a_signal_that_no_record_has_counts_nowhere() -> None:
    recording = without(Machine().record(SHORT), "P_B")
    record = join_records([read(recording, "a"), read(recording, "b")])

    assert record.has.tolist() == [True, True, False]
    assert np.isinf(record.noise[2])


def test_records_of_different_intervals_are_refused() -> None:
    slow = Machine(tick=2e-3).record(SHORT)

    with pytest.raises(ConfigError, match="a has a row each 1 ms and b each 2 ms"):
        join_records([read(Machine().record(SHORT), "a"), read(slow, "b")])
