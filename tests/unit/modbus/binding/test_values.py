"""Values of a tick, and settings that the devices take or refuse."""

import math

import pytest
from support.bus_side import VALVE, BusSide
from support.modbus_side import POSITION, PRESSURE_A, ModbusSide
from support.tables import from_text

from hil_bench import ConfigError, Faults, load_config
from hil_bench.abilities.modbus.binding import ModbusBinding
from hil_bench.abilities.modbus.protocol.register_map import Table


def test_the_sensors_show_what_the_plant_has(side):
    output = side.plant.output
    pressure = side.read(PRESSURE_A, Table.INPUT_REGISTERS, "pressure")
    assert pressure == pytest.approx(output.P_A * 1e-5, rel=1e-6)
    scaled = side.read(PRESSURE_A, Table.INPUT_REGISTERS, "pressure_scaled")
    assert scaled == pytest.approx(pressure, abs=0.005)
    assert side.read(PRESSURE_A, Table.INPUT_REGISTERS, "pressure_pa") == round(output.P_A)
    assert side.read(PRESSURE_A, Table.DISCRETE_INPUTS, "valid") == 1


def test_position_and_speed_are_those_of_the_same_tick(active):
    for _ in range(30):
        assert active.setpoint(0.5) == 0
    output = active.plant.output
    assert output.v > 0.05
    position = active.read(POSITION, Table.INPUT_REGISTERS, "position")
    # The encoder counts micrometres, and its speed 0.01 mm/s, by the steps in its EDS.
    assert position == pytest.approx(output.x * 1e3, abs=6e-3)
    speed = active.read(POSITION, Table.INPUT_REGISTERS, "speed")
    assert speed == pytest.approx(output.v * 1e3, abs=6e-1)


def test_each_tick_has_its_number_in_all_units(side):
    first = side.read(PRESSURE_A, Table.INPUT_REGISTERS, "sample")
    side.tick(count=3)
    for unit_id in (VALVE, PRESSURE_A, POSITION):
        assert side.read(unit_id, Table.INPUT_REGISTERS, "sample") == first + 3


def test_a_fault_of_a_sensor_shows_here_too(side):
    with side.bench.part(Faults).break_wire("pressure_a"):
        side.tick(count=2)
        assert side.read(PRESSURE_A, Table.DISCRETE_INPUTS, "valid") == 0
        assert math.isnan(side.read(PRESSURE_A, Table.INPUT_REGISTERS, "pressure"))
    side.tick(count=2)
    assert side.read(PRESSURE_A, Table.DISCRETE_INPUTS, "valid") == 1


def test_an_overload_is_no_value_and_says_why(side):
    device = side.bench.axes[0].sensors[0]
    output = side.plant.output._replace(P_A=400e5, P_B=400e5)
    device.take(output, side.now)
    side.binding.exchange(side.now)
    assert math.isnan(side.read(PRESSURE_A, Table.INPUT_REGISTERS, "pressure"))
    assert side.read(PRESSURE_A, Table.INPUT_REGISTERS, "pressure_pa") == -(2**31)
    bits = [
        side.read(PRESSURE_A, Table.DISCRETE_INPUTS, name)
        for name in ("valid", "over_range", "under_range")
    ]
    assert bits == [0, 1, 0]


def test_a_negative_watchdog_is_an_illegal_value(tmp_path, load_bench):
    (tmp_path / "map.toml").write_text(
        '[device]\nprofile = "valve_408"\nvendor_name = "m"\nproduct_code = "c"\nrevision = "1"\n'
        '[holding_registers.watchdog]\naddress = 0\ntype = "int16"\nunit = "ms"\n'
        'source = "watchdog"\naccess = "rw"\n'
    )
    side = ModbusSide(load_bench('[modbus.units.valve]\nregisters = "map.toml"\n'))
    assert side.write(VALVE, Table.HOLDING_REGISTERS, 0, 0xFFFF) == 3
    assert side.write(VALVE, Table.HOLDING_REGISTERS, 0, 5) == 0


def test_a_mask_changes_the_bits_that_it_has(side):
    image, registers = side.plan.units[PRESSURE_A], Table.HOLDING_REGISTERS
    assert side.write(PRESSURE_A, registers, 1, 0x12) == 0
    # The example of the specification, 6.16: 0x12, AND 0xF2, OR 0x25 is 0x17.
    number = side.plan.mailbox.post(image.parse_mask(1, 0xF2, 0x25))
    side.tick(count=2)
    assert side.plan.mailbox.answer_of(number) == 0
    assert side.read(PRESSURE_A, registers, "filter_constant") == 0x17


def test_a_mask_that_makes_an_illegal_value_is_refused(side):
    image, registers = side.plan.units[PRESSURE_A], Table.HOLDING_REGISTERS
    number = side.plan.mailbox.post(image.parse_mask(1, 0, 0))  # 0 samples are none
    side.tick(count=2)
    assert side.plan.mailbox.answer_of(number) == 3
    assert side.read(PRESSURE_A, registers, "filter_constant") == 1


def test_a_block_that_holds_a_setting_as_it_is_does_not_set_it_again(side):
    # The mean over 200 samples stands for 200 ms. Each write to the filter's objects starts it
    # again with the next sample: a master that writes all it has each 100 ms would never get one.
    repeating_average = 2
    assert side.write(PRESSURE_A, Table.HOLDING_REGISTERS, 0, repeating_average, 200) == 0
    side.tick(count=2)
    before = side.read(PRESSURE_A, Table.INPUT_REGISTERS, "pressure")
    with side.bench.part(Faults).offset("pressure_a", 10e5):
        assert side.write(PRESSURE_A, Table.HOLDING_REGISTERS, 0, repeating_average, 200) == 0
        side.tick(count=2)
        assert side.read(PRESSURE_A, Table.INPUT_REGISTERS, "pressure") == before
        assert side.write(PRESSURE_A, Table.HOLDING_REGISTERS, 1, 200) == 0
        side.tick(count=2)
        after = side.read(PRESSURE_A, Table.INPUT_REGISTERS, "pressure")
    assert after == pytest.approx(before + 10.0, abs=0.01)


def test_configuration_is_written_and_read_back(side):
    assert side.write(PRESSURE_A, Table.HOLDING_REGISTERS, 0, 1, 8) == 0
    assert side.read(PRESSURE_A, Table.HOLDING_REGISTERS, "filter_constant") == 8
    assert side.download(PRESSURE_A, 0x61A1, 1, b"\x09")[0] == 0x60
    side.tick()
    assert side.read(PRESSURE_A, Table.HOLDING_REGISTERS, "filter_constant") == 9


@pytest.mark.parametrize("value", [0, 256, 65535])
def test_a_value_that_the_device_refuses_is_illegal(side, value):
    # 0x61A1 is an UNSIGNED8, and 0 samples are none.
    assert side.write(PRESSURE_A, Table.HOLDING_REGISTERS, 1, value) == 3


def test_the_pressure_is_made_zero(side):
    assert side.write(PRESSURE_A, Table.COILS, 0, 1) == 0
    assert side.read(PRESSURE_A, Table.INPUT_REGISTERS, "pressure") == 0.0


def test_one_tick_obeys_one_request(side):
    image = side.plan.units[PRESSURE_A]
    numbers = [
        side.plan.mailbox.post(image.parse_write(Table.HOLDING_REGISTERS, 1, [value]))
        for value in (5, 6, 7)
    ]
    side.tick(count=2)
    assert side.read(PRESSURE_A, Table.HOLDING_REGISTERS, "filter_constant") == 5
    side.tick(count=2)
    assert side.read(PRESSURE_A, Table.HOLDING_REGISTERS, "filter_constant") == 7
    assert [side.plan.mailbox.answer_of(number) for number in numbers] == [0, 0, 0]


HEAD = """
[device]
profile = "pressure_404"
vendor_name = "maker"
product_code = "PT"
revision = "1"
"""


@from_text("register", "message")
def test_a_map_that_does_not_fit_its_device_is_refused(tmp_path, load_bench, register, message):
    (tmp_path / "map.toml").write_text(f"{HEAD}[holding_registers.x]\naddress = 0\n{register}\n")
    config = load_bench('[modbus.units.pressure_a]\nregisters = "map.toml"\n')
    with pytest.raises(ConfigError) as caught:
        ModbusBinding(config, BusSide(config).bench)
    assert str(caught.value).startswith(f"{tmp_path}/map.toml:holding_registers.x.")
    assert message in str(caught.value)


def test_a_bench_without_modbus_has_no_binding():
    config = load_config()
    with pytest.raises(ConfigError, match=r"has no table \[modbus\]; add one"):
        ModbusBinding(config, BusSide(config).bench)
