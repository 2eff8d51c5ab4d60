import dataclasses
import math

import pytest

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model import ConstantLoad, EndStop, PlantOptions


def test_paper_is_as_printed_with_the_tanh_of_section_iv():
    options = PlantOptions.paper()
    assert options.tanh_gain == 400.0
    assert options.end_stop is None
    assert options.cavitation_floor is None
    assert options.laminar_transition == 0.0
    assert options.signed_root


def test_bench_keeps_piston_and_pressures_where_they_can_be():
    options = PlantOptions.bench()
    assert options.end_stop == EndStop()
    assert options.cavitation_floor == -101_325.0  # standard atmosphere, as gauge pressure
    assert options.laminar_transition > 0.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tanh_gain": 0.0}, "tanh_gain = 0 s/m: must be greater than 0"),
        ({"tanh_gain": math.nan}, "tanh_gain = nan s/m: must be finite"),
        ({"tanh_gain": -math.inf}, "tanh_gain = -inf s/m: must be finite"),
        ({"laminar_transition": -1.0}, "laminar_transition = -1 Pa: must be 0 or greater"),
        ({"alpha_negative": 0.0}, "alpha_negative = 0 m: must be greater than 0"),
        ({"beta_negative": -1e-4}, "beta_negative = -0.0001 m: must be 0 or greater"),
        ({"cavitation_floor": 1e5}, "cavitation_floor = 100000 Pa: must be 0 or less"),
        (
            {"cavitation_floor": -2e5},
            "cavitation_floor = -200000 Pa: must be 0 or less",
        ),
        ({"cavitation_floor": True}, "cavitation_floor = True: must be a number in Pa"),
        ({"signed_root": "no"}, "signed_root = 'no': must be bool"),
        ({"end_stop": True}, "end_stop = True: must be EndStop or None"),
        ({"air": 0.01}, "air = 0.01: must be EntrainedAir or None"),
        ({"bristles": EndStop()}, "bristles = EndStop(stiffness=200000000.0, "),
        ({"supply": 1e7}, "supply = 10000000.0: must be SupplyUnit or None"),
        ({"loads": ConstantLoad(1.0)}, "loads = ConstantLoad(load_force=1.0): must be tuple"),
        ({"loads": (1.0,)}, "loads = 1.0: must be ConstantLoad or SpringLoad or MassOnSlope or "),
        ({"cavitation_floor": -math.inf}, "cavitation_floor = -inf Pa: must be finite"),
    ],
)
def test_refuses_senseless_options(change, message):
    with pytest.raises(ParameterError) as refusal:
        dataclasses.replace(PlantOptions.bench(), **change)
    assert str(refusal.value).startswith(message)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"stiffness": 0.0}, "stiffness of the end stop = 0 N/m: must be greater than 0"),
        ({"damping": -1.0}, "damping of the end stop = -1 N s/m: must be 0 or greater"),
    ],
)
def test_refuses_a_senseless_end_stop(change, message):
    with pytest.raises(ParameterError) as refusal:
        EndStop(**change)
    assert str(refusal.value).startswith(message)
