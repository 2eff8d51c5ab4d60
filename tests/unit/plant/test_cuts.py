"""Runs beside a run cut their steps where it does, so that they differ smoothly."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from hil_bench.plants.hydraulic_cylinder.model import PlantOptions, paper_parameters
from hil_bench.plants.hydraulic_cylinder.model.courses import open_cuts, run_course
from hil_bench.plants.hydraulic_cylinder.model.cuts import WHOLE, part_at
from hil_bench.plants.hydraulic_cylinder.model.extended_constants import pack_extended
from hil_bench.plants.hydraulic_cylinder.model.kernel import make_row

STEP = 5e-5
STEPS = 4000
START = np.array([0.0, 0.0, 4.85e6, 5.15e6, 0.0, 0.0, 0.0, 0.0, 1e7, 0.0, 0.0, 0.0])
# The piston breaks away and turns round again and again: that is where steps are cut.
REVERSALS = np.repeat([0.6e-3, -0.6e-3] * 4, STEPS // 8)

Values = npt.NDArray[np.float64]


def run(stiffness, cuts):
    """Return position and pressures of a piston on oil of so many times Table I's modulus."""
    table_1 = paper_parameters()
    parameters = replace(table_1, E=stiffness * table_1.E)
    constants = make_row(pack_extended(parameters, PlantOptions.bench(), STEP))
    return run_course(constants, START, REVERSALS, every=20, cuts=cuts)[0]


@pytest.mark.parametrize(
    ("cuts", "sizes"),
    [
        ([], {0: 64}),
        ([16, 32, 48], {0: 16, 16: 16, 48: 16}),
        ([4, 8, 12, 16, 32, 48], {0: 4, 12: 4, 16: 16, 48: 16}),
        ([16, 32, 48, 52, 56, 60, 61, 62, 63], {32: 16, 56: 4, 60: 1, 63: 1}),
    ],
)
def test_cuts_say_how_long_each_part_is(cuts, sizes):
    code = sum(1 << (end - 1) for end in cuts)

    assert {done: part_at(code, done) for done in sizes} == sizes


def test_a_run_that_keeps_its_cuts_or_follows_them_has_the_same_bits():
    alone, cuts = run(1.0, open_cuts(STEPS)), open_cuts(STEPS)

    kept = run(1.0, cuts)
    taken = cuts.copy()
    followed = run(1.0, cuts)

    assert kept.tobytes() == alone.tobytes()
    assert followed.tobytes() == alone.tobytes()
    assert (taken >= WHOLE).all()
    assert (taken > WHOLE).any()  # or this run says nothing
    assert np.array_equal(cuts, taken)


def test_a_run_beside_another_cuts_its_steps_there():
    here, beside = open_cuts(STEPS), open_cuts(STEPS)
    run(1.0, here)
    run(1.01, beside)
    followed = here.copy()

    run(1.01, followed)

    assert not np.array_equal(here, beside)  # left to themselves they differ
    assert np.array_equal(followed, here)


def test_differences_of_runs_with_the_same_cuts_are_smooth():
    cuts = open_cuts(STEPS)
    run(1.0, cuts)
    shifts = 3e-4 * np.arange(-10, 11)

    def roughness(make):
        """Return the largest second difference of the velocity over the shifts."""
        velocity = make[:, :, 1]
        return float(np.abs(np.diff(velocity, 2, axis=0)).max())

    alone = roughness(np.array([run(1.0 + shift, open_cuts(STEPS)) for shift in shifts]))
    along = roughness(np.array([run(1.0 + shift, cuts) for shift in shifts]))

    assert along < 0.2 * alone
