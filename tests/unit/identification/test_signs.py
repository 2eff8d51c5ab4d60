"""Polarities that are unknown, and such that cannot be right."""

import numpy as np
import pytest
from support.machine_record import FULL_OPENING, Machine, random_steps

from hil_bench.abilities.identification.record import AxisRecord
from hil_bench.abilities.identification.signs import check_sides, settle_signs
from hil_bench.errors import ConfigError
from hil_bench.plants.hydraulic_cylinder.model import paper_parameters

SIGNALS = ("position", "P_A", "P_B", "spool_setpoint")


@pytest.fixture(scope="module")
def recording():
    return Machine().record(random_steps(0.5e-3, 1e-3, 34, 100))


def turned(recording, *names):
    copy = recording.copy()
    for name in names:
        copy[f"axis1.{name}"] *= -1.0
    return AxisRecord.of(copy, "axis1", FULL_OPENING)


@pytest.mark.parametrize(
    "wrong", [(), ("position",), ("spool_setpoint",), ("P_A",), ("P_B", "position"), SIGNALS]
)
def test_unknown_polarities_are_found(recording, wrong):
    right = turned(recording)

    found = settle_signs(turned(recording, *wrong), set(SIGNALS))

    assert found.measured == pytest.approx(right.measured)
    assert found.setpoints == pytest.approx(right.setpoints)
    assert len(found.notes) == 4


def test_one_pressure_tells_which_way_the_piston_goes(recording):
    names = [name for name in recording.dtype.names or () if name != "axis1.P_A"]

    found = settle_signs(turned(recording[names], "position"), {"position"})

    assert found.measured[:, 0] == pytest.approx(recording["axis1.position"])


@pytest.mark.parametrize(
    ("wrong", "complaint"),
    [
        ("spool_setpoint", "retracts where spool_setpoint is above zero"),
        ("position", "the piston accelerates against its pressures"),
    ],
)
def test_a_polarity_that_is_given_wrong_is_refused(recording, wrong, complaint):
    with pytest.raises(ConfigError, match=complaint):
        settle_signs(turned(recording, wrong), set())


def test_a_command_that_has_nothing_to_do_with_the_motion_decides_nothing(recording):
    record = turned(recording)
    record.setpoints[:] = np.random.default_rng(2).uniform(-1e-3, 1e-3, len(record))

    with pytest.raises(ConfigError, match="polarity of spool_setpoint is not decidable"):
        settle_signs(record, {"spool_setpoint"})


def test_a_motion_that_no_pressure_goes_with_decides_nothing(recording):
    record = turned(recording)
    noise = np.random.default_rng(3).standard_normal(len(record))
    record.measured[:, 0] = np.linspace(0.0, 0.1, len(record)) + 2e-6 * noise

    with pytest.raises(ConfigError, match="polarity of position is not decidable"):
        settle_signs(record, {"position"})


def test_pressures_that_are_exchanged_are_refused(recording):
    swapped = recording.copy()
    swapped["axis1.P_A"], swapped["axis1.P_B"] = recording["axis1.P_B"], recording["axis1.P_A"]

    check_sides(turned(recording), paper_parameters())
    with pytest.raises(ConfigError, match="exchange the columns of P_A and P_B"):
        check_sides(AxisRecord.of(swapped, "axis1", FULL_OPENING), paper_parameters())
