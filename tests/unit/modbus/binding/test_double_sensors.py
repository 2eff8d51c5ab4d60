"""Sensors with two channels on Modbus: what the registers show is what each channel measures."""

import pytest
from support.modbus_side import ModbusSide

from hil_bench.abilities.modbus.protocol.register_map import Table

BENCH = """
[plant.axis1]
load_n = 5000
position_mm = 50
[nodes]
valve = { profile = "valve_408", node_id = 1 }
pressures = { profile = "transducer_404", node_id = 2, temperature_c = 55.0 }
position = { profile = "encoder_redundant_406", node_id = 4 }
[modbus.units]
valve = { commands = true }
[modbus.units.pressures]
[modbus.units.position]
"""
INPUTS = Table.INPUT_REGISTERS
TRANSDUCER, ENCODER = 2, 4


@pytest.fixture
def side(load_bench):
    side = ModbusSide(load_bench(BENCH))
    side.tick(count=2)
    return side


def test_both_pressures_and_the_temperature(side):
    """At rest P_A A_A - P_B A_B = 5 kN, with the areas of Table I, and 100 bar in both together."""
    names = ("pressure", "pressure_2", "temperature", "status_2", "status_3")
    at_a, at_b, temperature, *statuses = (side.read(TRANSDUCER, INPUTS, name) for name in names)
    assert at_a * 1e5 * 50e-4 - at_b * 1e5 * 47e-4 == pytest.approx(5000.0, rel=1e-3)
    assert at_a + at_b == pytest.approx(100.0, rel=1e-3)
    assert temperature == 55.0
    assert statuses == [0, 0]


def test_both_measuring_systems(side):
    assert side.read(ENCODER, INPUTS, "position") == pytest.approx(50.0, abs=1e-2)
    assert side.read(ENCODER, INPUTS, "position_2") == pytest.approx(50.0, abs=1e-2)
    # 10000 steps of 1 um: the second system alone counts anew
    assert side.write(ENCODER, Table.HOLDING_REGISTERS, 2, 0, 10000) == 0
    side.tick(count=2)
    assert side.read(ENCODER, INPUTS, "position_2") == pytest.approx(10.0, abs=1e-2)
    assert side.read(ENCODER, INPUTS, "position") == pytest.approx(50.0, abs=1e-2)
