"""Runs with extensions from many starts: the bits of a single plant, and cuts that are followed."""

from dataclasses import replace

import numpy as np
import pytest

from hil_bench.plants.hydraulic_cylinder.model import (
    ConstantLoad,
    Cushion,
    EntrainedAir,
    FullOrderPlant,
    MassOnSlope,
    MeteringLands,
    PlantInput,
    PlantOptions,
    Solver,
    SpringLoad,
    balanced_state,
    paper_parameters,
)
from hil_bench.plants.hydraulic_cylinder.model.batch import LANES, NO_CUTS, spread_setpoints
from hil_bench.plants.hydraulic_cylinder.model.cuts import OPEN
from hil_bench.plants.hydraulic_cylinder.model.extended_batch import (
    run_extended_starts,
    states_without_start,
)
from hil_bench.plants.hydraulic_cylinder.model.loads import LoadSeries

STEP, STEPS, EVERY = 1e-4, 400, 10
PARAMETERS = paper_parameters()
BENCH = PlantOptions.bench()
EXTENDED = {
    "air": replace(BENCH, air=EntrainedAir(air_fraction=0.02, air_exponent=1.4)),
    "loads": replace(
        BENCH,
        loads=(ConstantLoad(load_force=4e3), SpringLoad(spring_stiffness=5e4, spring_rest=0.0)),
    ),
    "leakage": replace(BENCH, C_LA=1e-13, C_LB=2e-13),
    "lands": replace(BENCH, lands=MeteringLands(gain_pb=0.84, saturation=0.5)),
    "edges": replace(BENCH, lands=MeteringLands(overlap_pa=2e-4, null_opening=1e-6)),
}


@pytest.mark.parametrize("name", EXTENDED)
def test_a_run_has_the_bits_of_a_single_plant(name: str) -> None:
    options = EXTENDED[name]
    source = np.random.default_rng(2)
    starts = [balanced_state(PARAMETERS, x=x) for x in (0.0, 0.05, 0.1995)]  # the last hits a stop
    openings = np.repeat(source.uniform(-1.3e-3, 1.3e-3, (len(starts), STEPS // 100)), 100, axis=1)

    seen = run_extended_starts(
        (PARAMETERS, options),
        np.array(starts),
        spread_setpoints(openings),
        dt=STEP,
        every=EVERY,
        cuts=NO_CUTS,
    )

    for number, state in enumerate(starts):
        plant = FullOrderPlant(
            PARAMETERS,
            options=options,
            solver=Solver.LINEARLY_IMPLICIT_MIDPOINT,
            dt=STEP,
            state=state,
        )
        alone = []
        for step, u in enumerate(openings[number].tolist(), start=1):
            output = plant.step(PlantInput(u))
            if step % EVERY == 0:
                alone.append((output.x, output.v, output.P_A, output.P_B, output.z))
        assert np.array_equal(seen[number], np.array(alone))


def test_cuts_are_taken_down_and_followed() -> None:
    starts = np.array([balanced_state(PARAMETERS, x=0.1995)])
    setpoints = spread_setpoints(np.full((1, STEPS), 1.3e-3))
    cuts = np.full((STEPS, LANES), OPEN, dtype=np.int64)
    plant, how = (PARAMETERS, EXTENDED["air"]), {"dt": STEP, "every": 1}

    found = run_extended_starts(plant, starts, setpoints, cuts=cuts, **how)
    again = run_extended_starts(plant, starts, setpoints, cuts=cuts.copy(), **how)
    whole = run_extended_starts(plant, starts, setpoints, cuts=np.zeros_like(cuts), **how)

    assert (cuts[:, 0] > 0).any()  # where the stop is hit
    assert np.array_equal(found, again)
    assert not np.array_equal(found, whole)


def test_what_has_states_of_its_own_is_named() -> None:
    assert states_without_start(EXTENDED["air"]) == []
    series = replace(BENCH, loads=(LoadSeries((0.0, 1.0), (0.0, 1e3)),))
    assert states_without_start(series) == ["a load over time"]
    slope = replace(BENCH, loads=(MassOnSlope(load_mass=100.0, slope=0.5),))
    assert states_without_start(slope) == []
    cushion = Cushion(length=0.02, orifice=1e-3)
    assert states_without_start(replace(BENCH, cushion_a=cushion)) == []
