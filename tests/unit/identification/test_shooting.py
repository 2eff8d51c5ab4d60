"""Pieces of a record beside the model: where they start."""

from dataclasses import replace

import numpy as np
import pytest
from support.machine_record import FULL_OPENING, Machine

from hil_bench.identification.record import AxisRecord
from hil_bench.identification.shooting import Shooting, cut_pieces
from hil_bench.identification.unknowns import Guess
from hil_bench.plant import PlantOptions, paper_parameters

STEP = 1e-4


@pytest.fixture(scope="module")
def creeping() -> Shooting:
    """Return pieces of a slow ramp, in which the piston sticks, creeps, and lets go."""
    ramp = np.linspace(0.0, 0.5e-3, 1800)
    recording = Machine(step=STEP).record(np.concatenate([ramp, ramp[::-1]]))
    record = AxisRecord.of(recording, "axis1", FULL_OPENING)
    pieces = cut_pieces(record, record.fitted, 200, paper_parameters().h)
    substeps = round(record.interval / STEP)
    return Shooting(record, PlantOptions.bench(), pieces, substeps, record.noise)


def test_starts_settle_wherever_the_piston_sticks(creeping: Shooting) -> None:
    guess = Guess(paper_parameters(), np.zeros(2))

    creeping.settle(guess)

    # What is left is noise: 600 values a piece, so that the rms scatters by 3 %.
    assert creeping.misfits(guess).max() < 1.15


def test_starts_follow_a_parameter(creeping: Shooting) -> None:
    table_1 = paper_parameters()
    here = Guess(table_1, np.zeros(2))
    there = Guess(replace(table_1, F_c=1.001 * table_1.F_c), np.zeros(2))
    creeping.settle(here)
    left = creeping.states

    followed = left + creeping.follow(here, [there])[0]
    creeping.settle(there)

    stale, led, settled = (
        float(np.square(creeping.deviations(there, states) / creeping.scale).sum())
        for states in (left, followed, creeping.states)
    )
    # What is left over is of second order.
    assert led - settled < 0.05 * (stale - settled)
