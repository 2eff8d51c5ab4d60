import pytest
from support.modbus_side import CONTROL, ENABLE, ModbusSide

UNITS = """
[modbus.units]
valve = { commands = true, watchdog_ms = 100 }
[modbus.units.pressure_a]
[modbus.units.pressure_b]
[modbus.units.position]
"""


@pytest.fixture
def side(load_bench):
    return ModbusSide(load_bench(UNITS))


@pytest.fixture
def active(side):
    assert (side.coil(CONTROL, 1), side.coil(ENABLE, 1)) == (0, 0)
    return side
