"""The spool from its set-points, and its fit."""

from dataclasses import replace

import numpy as np
import pytest
from support.machine_record import FULL_OPENING, Machine, random_steps, step_spool

from hil_bench.abilities.identification.record import AxisRecord
from hil_bench.abilities.identification.spool import fit_spool, spool_states
from hil_bench.plants.hydraulic_cylinder.model import paper_parameters


def test_states_follow_equation_1() -> None:
    parameters = paper_parameters()
    setpoints = np.concatenate([np.zeros(3), random_steps(0.2e-3, 1e-3, count=5, rows=4)])

    states = spool_states(parameters, setpoints, 1e-3)

    # small Euler steps of 5 us are right within omega_0 dt = 0.6 %
    assert states[:, 0] == pytest.approx(step_spool(parameters, setpoints, 1e-3), abs=1.3e-5)
    at_rest = spool_states(parameters, np.full(4, 5e-4), 1e-3)
    assert at_rest == pytest.approx(np.tile([5e-4, 0.0], (4, 1)), abs=1e-12)


def test_bandwidth_and_damping_come_from_a_recorded_spool() -> None:
    spool = replace(paper_parameters(), omega_0=900.0, xi=0.9)
    machine = Machine(parameters=spool, has_spool=True)
    record = AxisRecord.of(
        machine.record(random_steps(0.6e-3, 1e-3, 32, 100)), "axis1", FULL_OPENING
    )

    found = fit_spool(record, paper_parameters())

    # as good as the Euler steps that made the record
    assert found["omega_0"][0] == pytest.approx(900.0, rel=0.01)
    assert found["xi"][0] == pytest.approx(0.9, rel=0.01)
    assert 0.0 < found["omega_0"][1] < 9.0


def test_nothing_comes_from_a_spool_that_was_not_recorded() -> None:
    record = AxisRecord.of(
        Machine().record(random_steps(0.6e-3, 1e-3, 32, 100)), "axis1", FULL_OPENING
    )

    assert fit_spool(record, paper_parameters()) == {}
