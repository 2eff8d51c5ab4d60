"""What the trim does not know, it refuses."""

import pytest

from hil_bench.abilities.analysis.operating_point import find_operating_point
from hil_bench.abilities.analysis.steady_motion import OperatingPointError
from hil_bench.plants.hydraulic_cylinder.model import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.extensions import (
    CounterbalanceValve,
    LuGreFriction,
    SupplyUnit,
)
from hil_bench.plants.hydraulic_cylinder.model.line import Line
from hil_bench.plants.hydraulic_cylinder.model.loads import ConstantLoad


@pytest.mark.parametrize(
    "options",
    [
        PlantOptions(bristles=LuGreFriction()),
        PlantOptions(supply=SupplyUnit()),
        PlantOptions(
            counterbalance=CounterbalanceValve(
                in_line_a=True, setting=1e7, pilot_ratio=3.0, conductance=1e-6
            )
        ),
        PlantOptions(line_b=Line(length=1.0, inner=0.01, bulk_modulus=1e9)),
        PlantOptions(loads=(ConstantLoad(10.0),)),
    ],
)
def test_options_with_states_or_loads_of_their_own_are_refused(table_1, options):
    with pytest.raises(OperatingPointError, match="give what acts on the rod as the load F_L"):
        find_operating_point(table_1, options, velocity=0.1)
