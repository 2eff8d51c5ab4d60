"""Pieces of a record beside the model: where they start."""

import numpy as np
import pytest
from support.machine_record import FULL_OPENING, Machine

from hil_bench.abilities.identification.pieces import cut_pieces
from hil_bench.abilities.identification.record import AxisRecord
from hil_bench.abilities.identification.shooting import Shooting
from hil_bench.abilities.identification.smoothing import smooth_states
from hil_bench.abilities.identification.unknowns import Guess
from hil_bench.plants.hydraulic_cylinder.model import PlantOptions, paper_parameters

STEP = 1e-4


@pytest.fixture(scope="module")
def creeping() -> Shooting:
    """Return pieces of a slow ramp, in which the piston sticks, creeps, and lets go."""
    ramp = np.linspace(0.0, 0.5e-3, 1800)
    recording = Machine(step=STEP).record(np.concatenate([ramp, ramp[::-1]]))
    record = AxisRecord.of(recording, "axis1", FULL_OPENING)
    pieces = cut_pieces(record, record.fitted, 200, paper_parameters().h)
    substeps = round(record.interval / STEP)
    smoothed = smooth_states(record, paper_parameters())
    return Shooting(record, PlantOptions.bench(), pieces, substeps, record.noise, smoothed)


def test_starts_settle_wherever_the_piston_sticks(creeping: Shooting) -> None:
    guess = Guess(paper_parameters(), np.zeros((1, 2)))

    creeping.settle(guess)

    # What is left is noise: 600 values a piece, so that the rms scatters by 3 %.
    assert creeping.misfits(guess).max() < 1.15


def test_a_start_that_is_far_off_comes_from_the_piece_before(creeping: Shooting) -> None:
    guess = Guess(paper_parameters(), np.zeros((1, 2)))
    creeping.settle(guess)
    settled = creeping.misfits(guess)
    creeping.states[4] += [0.0, 0.4, 2e6, -2e6]  # nowhere near the record
    lost = creeping.misfits(guess)

    creeping.relay(guess)

    found = creeping.misfits(guess)
    assert lost[4] > 10.0
    assert found[4] == pytest.approx(settled[4], rel=0.01)
    others = np.arange(len(found)) != 4
    assert found[others] == pytest.approx(settled[others])


def test_steps_for_slopes_are_small_beside_the_noise_in_every_piece(creeping: Shooting) -> None:
    guess = Guess(paper_parameters(), np.zeros((1, 2)))
    creeping.settle(guess)
    creeping.slopes(guess)  # finds the steps

    moved = [creeping.states, *(creeping.states + creeping.steps * one for one in np.eye(4))]
    raw = creeping.raw([guess] * 5, moved)

    sizes = np.linalg.norm(raw[1:] - raw[0], axis=2)
    assert sizes.max() < 0.1  # of the noise, over 600 values


@pytest.mark.parametrize("end", [np.nan, np.inf, 1e30])
def test_a_run_that_diverges_starts_no_other_piece(
    creeping: Shooting, monkeypatch: pytest.MonkeyPatch, end: float
) -> None:
    guess = Guess(paper_parameters(), np.zeros((1, 2)))
    creeping.settle(guess)
    creeping.states[4] += [0.0, 0.4, 2e6, -2e6]
    monkeypatch.setattr(Shooting, "_ends", lambda *_: np.full_like(creeping.states, end))

    creeping.relay(guess)

    assert (np.abs(creeping.states) < 1e9).all()  # Pa at most
