import pytest
from support.modbus_side import CONTROL, ENABLE, ModbusSide

from hil_bench.bench.configuration import load_config

UNITS = """
[modbus.units.valve]
commands = true
watchdog_ms = 100
[modbus.units.pressure_a]
[modbus.units.pressure_b]
[modbus.units.position]
"""


@pytest.fixture
def side(tmp_path):
    path = tmp_path / "bench.toml"
    path.write_text(UNITS)
    return ModbusSide(load_config(path))


@pytest.fixture
def active(side):
    assert (side.coil(CONTROL, 1), side.coil(ENABLE, 1)) == (0, 0)
    return side
