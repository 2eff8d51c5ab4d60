"""Whole courses of one plant: the bits of a single plant, and cuts that are followed."""

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
    SupplyUnit,
    balanced_state,
    paper_parameters,
)
from hil_bench.plants.hydraulic_cylinder.model.constants import pack_extended
from hil_bench.plants.hydraulic_cylinder.model.courses import (
    open_cuts,
    run_course,
    states_without_start,
)
from hil_bench.plants.hydraulic_cylinder.model.kernel import make_row
from hil_bench.plants.hydraulic_cylinder.model.load import LoadSeries

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
    "slow spool": replace(BENCH, spool_speed=0.02, C_LA=1e-13),
    "supply": replace(BENCH, supply=SupplyUnit(pump_flow=2e-4, relief_pressure=1e7)),
    "edges": replace(BENCH, lands=MeteringLands(overlap_pa=2e-4, null_opening=1e-6)),
}


@pytest.mark.parametrize("name", EXTENDED)
def test_a_run_has_the_bits_of_a_single_plant(name):
    options = EXTENDED[name]
    source = np.random.default_rng(2)
    starts = [balanced_state(PARAMETERS, x=x) for x in (0.0, 0.05, 0.1995)]  # the last hits a stop
    openings = np.repeat(source.uniform(-1.3e-3, 1.3e-3, (len(starts), STEPS // 100)), 100, axis=1)

    constants = make_row(pack_extended(PARAMETERS, options, STEP))

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
        seen, supply = run_course(
            constants,
            np.array([*state, PARAMETERS.P_S, 0.0, 0.0, 0.0]),
            openings[number],
            every=EVERY,
            cuts=open_cuts(STEPS),
        )
        assert np.array_equal(seen, np.array(alone))
        assert supply == plant.supply_pressure


def test_cuts_are_taken_down_and_followed():
    start = np.array([*balanced_state(PARAMETERS, x=0.1995), PARAMETERS.P_S, 0.0, 0.0, 0.0])
    setpoints, cuts = np.full(STEPS, 1.3e-3), open_cuts(STEPS)
    constants = make_row(pack_extended(PARAMETERS, EXTENDED["air"], STEP))

    found, _ = run_course(constants, start, setpoints, every=1, cuts=cuts)
    again, _ = run_course(constants, start, setpoints, every=1, cuts=cuts.copy())
    whole, _ = run_course(constants, start, setpoints, every=1, cuts=np.zeros_like(cuts))

    assert (cuts > 0).any()  # where the stop is hit
    assert np.array_equal(found, again)
    assert not np.array_equal(found, whole)


def test_what_has_states_of_its_own_is_named():
    assert states_without_start(EXTENDED["air"]) == []
    series = replace(BENCH, loads=(LoadSeries((0.0, 1.0), (0.0, 1e3)),))
    assert states_without_start(series) == ["a load over time"]
    slope = replace(BENCH, loads=(MassOnSlope(load_mass=100.0, slope=0.5),))
    assert states_without_start(slope) == []
    cushion = Cushion(length=0.02, orifice=1e-3)
    assert states_without_start(replace(BENCH, cushion_a=cushion)) == []
