import math
from dataclasses import replace

import pytest

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import (
    ConstantLoad,
    FullOrderPlant,
    LoadSeries,
    MassOnSlope,
    PlantInput,
    PlantOptions,
    ReducedOrderPlant,
    Solver,
    SpringLoad,
    paper_parameters,
)
from hil_bench.plants.hydraulic_cylinder.model.line import Line


@pytest.mark.parametrize(
    ("slope_deg", "weight"),
    [  # 100 kg * 9.80665 m/s² * sin(slope)
        (0.0, 0.0),
        (30.0, 490.3325),
        (90.0, 980.665),
        (-90.0, -980.665),
    ],
)
def test_weight_on_a_slope(slope_deg, weight):
    assert MassOnSlope(100.0, math.radians(slope_deg)).weight == pytest.approx(weight, rel=1e-12)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: ConstantLoad(math.nan), "load_force = nan N: must be finite"),
        (lambda: SpringLoad(0.0), "spring_stiffness = 0 N/m: must be greater than 0"),
        (lambda: SpringLoad(1.0, math.inf), "spring_rest = inf m: must be finite"),
        (lambda: MassOnSlope(-1.0), "load_mass = -1 kg: must be 0 or greater"),
        (lambda: MassOnSlope(1.0, 1.6), "slope = 1.6 rad: must lie between -pi/2 and pi/2"),
        (lambda: LoadSeries((), ()), "load_series = 0 times and 0 forces: must be one force"),
        (lambda: LoadSeries((0.0,), (1.0, 2.0)), "load_series = 1 times and 2 forces: must be"),
        (
            lambda: LoadSeries((1.0, 0.5), (0.0, 0.0)),
            "load_series = 0.5 s after 1 s: its times must not decrease",
        ),
        (lambda: LoadSeries(0.0, 1.0), "times of load_series = 0.0: must be tuple or list"),
        (lambda: LoadSeries((0.0,), "1"), "forces of load_series = '1': must be tuple or list"),
        (lambda: LoadSeries((0.0,), (math.nan,)), "force of load_series = nan N: must be finite"),
        (lambda: LoadSeries((math.inf,), (0.0,)), "time of load_series = inf s: must be finite"),
    ],
)
def test_refuses_a_senseless_load(build, message):
    with pytest.raises(ParameterError) as refusal:
        build()
    assert str(refusal.value).startswith(message)


def test_force_of_each_load_at_a_place_and_a_time():
    loads = (
        ConstantLoad(100.0),
        SpringLoad(1e3, 0.1),
        MassOnSlope(10.0, math.radians(90.0)),
        LoadSeries((1.0, 2.0), (0.0, 50.0)),
    )
    forces = [load.force_at(0.3, 1.5) for load in loads]
    assert forces == pytest.approx([100.0, 200.0, 98.0665, 25.0])
    assert PlantOptions(loads=loads).load_at(0.3, 1.5) == pytest.approx(423.0665)


HOSE = Line(length=0.1, inner=0.0125, bulk_modulus=850e6, viscosity=46e-6)
LINED = {"line_a": HOSE, "line_b": replace(HOSE, length=0.2)}
STEP = 5e-5


def plant(kind, solver, *loads):
    options = replace(PlantOptions.bench(), loads=loads)
    if kind == "reduced":
        return ReducedOrderPlant(paper_parameters(), options=options, solver=solver, dt=STEP)
    extra = LINED if kind == "lined" else {"C_LA": 1e-13}
    options = replace(options, **extra)
    return FullOrderPlant(paper_parameters(), options=options, solver=solver, dt=STEP)


CASES = [("lined", Solver.LINEARLY_IMPLICIT_MIDPOINT)]
CASES += [(kind, solver) for kind in ("reduced", "extended") for solver in Solver]


@pytest.mark.parametrize(("kind", "solver"), CASES)
def test_a_load_of_the_options_acts_as_one_from_outside(kind, solver):
    inside, free = plant(kind, solver, ConstantLoad(4e3)), plant(kind, solver)
    outside = type(free)(
        paper_parameters(), options=free.options, solver=solver, state=inside.state, dt=STEP
    )
    for _ in range(10):
        assert inside.step(PlantInput(6e-4), 4) == outside.step(PlantInput(6e-4, 4e3), 4)


@pytest.mark.parametrize(("kind", "solver"), CASES)
def test_a_series_acts_from_its_time_on(kind, solver):
    """Nothing for 10.5 steps, then a force at once; a step before that it has no effect."""
    jump = 10.5 * STEP
    series = plant(kind, solver, LoadSeries((jump, jump), (0.0, 9e3)))
    free = plant(kind, solver, LoadSeries((jump,), (0.0,)))
    for _ in range(10):
        assert series.step(PlantInput(6e-4)) == free.step(PlantInput(6e-4))
    later = series.step(PlantInput(6e-4), 3), free.step(PlantInput(6e-4), 3)
    assert later[0].v < later[1].v - 1e-3
