import math

import pytest

from hil_bench import units
from hil_bench.units import Unit

ALL = [value for value in vars(units).values() if isinstance(value, Unit)]


@pytest.mark.parametrize(
    ("unit", "value", "si"),
    [
        # By definition of the units (SI brochure): 1 bar = 1e5 Pa, 1 l = 1e-3 m³, 1 min = 60 s.
        (units.BAR, 210.0, 21.0e6),
        (units.MEGAPASCAL, 1000.0, 1.0e9),
        (units.MILLIMETRE, 400.0, 0.4),
        (units.SQUARE_CENTIMETRE, 50.0, 5.0e-3),
        (units.CUBIC_CENTIMETRE, 1200.0, 1.2e-3),
        (units.MILLIMETRE_PER_SECOND, 20.0, 0.02),
        (units.NEWTON_PER_MILLIMETRE, 2e5, 2e8),
        (units.PERCENT, 50.0, 0.5),
        (units.MICROSECOND, 1000.0, 1e-3),
        # 6 l/min at 1 bar is 1e-4 m³/s at 1e5 Pa.
        (units.LITRE_PER_MINUTE_BAR, 6.0, 1e-9),
        (units.KILOGRAM, 20.0, 20.0),
        (units.PASCAL, 300.0, 300.0),
    ],
)
def test_a_unit_converts_to_si_and_back(unit, value, si):
    assert math.isclose(unit.to_si(value), si, rel_tol=1e-15)
    assert math.isclose(unit.from_si(si), value, rel_tol=1e-15)


def test_no_two_units_share_a_symbol_or_a_suffix():
    assert len({unit.symbol for unit in ALL}) == len(ALL)
    assert len({unit.suffix for unit in ALL}) == len(ALL)
