"""The loop's end: values of a tick, and writes that the devices take or refuse."""

import math
import struct

import pytest
from support.bus_side import VALVE, BusSide

from hil_bench.bench.configuration import load_config
from hil_bench.bench.modbus_binding import ModbusBinding
from hil_bench.errors import ConfigError
from hil_bench.outside.modbus.exceptions import ModbusException
from hil_bench.outside.modbus.register_map import Table

UNITS = """
[modbus.units.valve]
commands = true
watchdog_ms = 100
[modbus.units.pressure_a]
[modbus.units.pressure_b]
[modbus.units.position]
"""
PRESSURE_A, POSITION = 2, 4


class ModbusSide(BusSide):
    """A bench with CAN on one side and register tables on the other."""

    def __init__(self, config):
        super().__init__(config)
        self.binding = ModbusBinding(config, self.bench)
        self.plan = self.binding.plan
        self.tick()

    def tick(self, *frames, count=1):
        sent = []
        for number in range(count):
            sent += super().tick(*(frames if number == 0 else ()))
            if hasattr(self, "binding"):
                self.binding.exchange(self.now)
        return sent

    def read(self, unit_id, table, name):
        """Read one value by its name, through the registers."""
        image = self.plan.units[unit_id]
        for _, register in image._tables[table]._registers:
            if register.name == name:
                row = self.plan.rows.read()
                words = image.read(
                    table, register.address, register.count, row.sequence, row.values
                )
                if table.holds_bits:
                    return words[0]
                return register.data_type.decode(words, register.word_order) * register.scale
        raise AssertionError(name)

    def write(self, unit_id, table, address, *words):
        """Write, and tick until it is answered; returns the exception code, 0 for none."""
        try:
            assignments = self.plan.units[unit_id].parse_write(table, address, words)
        except ModbusException as refusal:
            return refusal.code
        number = self.plan.mailbox.post(assignments)
        self.tick()
        assert self.plan.mailbox.answer_of(number) is None
        self.tick()
        return self.plan.mailbox.answer_of(number)

    def coil(self, address, value):
        return self.write(VALVE, Table.COILS, address, value)

    def setpoint(self, fraction):
        words = struct.unpack(">2H", struct.pack(">f", fraction))
        return self.write(VALVE, Table.HOLDING_REGISTERS, 0, *words)

    def status(self):
        return int(self.read(VALVE, Table.INPUT_REGISTERS, "status_word"))


CONTROL, ENABLE, RESET = 0, 1, 2
INIT, DISABLED, ACTIVE, FAULT_HOLD, LOCAL = 0x08, 0x09, 0x0F, 0x03, 0x10


@pytest.fixture
def side(tmp_path):
    path = tmp_path / "bench.toml"
    path.write_text(UNITS)
    return ModbusSide(load_config(path))


@pytest.fixture
def active(side):
    assert (side.coil(CONTROL, 1), side.coil(ENABLE, 1)) == (0, 0)
    return side


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
    with side.bench.faults.break_wire("pressure_a"):
        side.tick(count=2)
        assert side.read(PRESSURE_A, Table.DISCRETE_INPUTS, "valid") == 0
        assert math.isnan(side.read(PRESSURE_A, Table.INPUT_REGISTERS, "pressure"))
    side.tick(count=2)
    assert side.read(PRESSURE_A, Table.DISCRETE_INPUTS, "valid") == 1


def test_an_overload_is_no_value_and_says_why(side):
    device = side.bench.axes[0].sensors[0]
    output = side.plant.output._replace(P_A=400e5, P_B=400e5)
    device(output, side.now)
    side.binding.exchange(side.now)
    assert math.isnan(side.read(PRESSURE_A, Table.INPUT_REGISTERS, "pressure"))
    assert side.read(PRESSURE_A, Table.INPUT_REGISTERS, "pressure_pa") == -(2**31)
    bits = [
        side.read(PRESSURE_A, Table.DISCRETE_INPUTS, name)
        for name in ("valid", "over_range", "under_range")
    ]
    assert bits == [0, 1, 0]


def test_modbus_takes_control_without_nmt_and_gives_it_back(active):
    assert active.status() == ACTIVE | LOCAL
    assert active.setpoint(0.25) == 0
    active.tick(count=20)
    spool = active.read(VALVE, Table.INPUT_REGISTERS, "spool_position")
    assert spool == pytest.approx(0.25, abs=1e-3)
    assert active.coil(CONTROL, 0) == 0
    assert active.status() == INIT
    active.tick(count=20)
    assert active.read(VALVE, Table.INPUT_REGISTERS, "spool_position") == pytest.approx(0, abs=1e-3)


def test_commands_without_control_are_refused(side):
    assert side.coil(ENABLE, 1) == 4
    assert side.setpoint(0.1) == 4
    assert side.status() == INIT


@pytest.mark.parametrize(
    ("table", "address", "words"),
    [
        (Table.COILS, 0, [0, 0, 0]),  # control, enable, reset
        (Table.COILS, ENABLE, [0]),
        (Table.COILS, RESET, [0]),
        (Table.HOLDING_REGISTERS, 0, [0, 0]),  # set-point 0.0
        (Table.HOLDING_REGISTERS, 0, [0x8000, 0]),  # set-point -0.0
        (Table.HOLDING_REGISTERS, 2, [0]),  # control word
        (Table.HOLDING_REGISTERS, 4, [0]),  # set-point as an integer
        (Table.HOLDING_REGISTERS, 5, [0]),  # control
        (Table.HOLDING_REGISTERS, 0, [0, 0, 0, 500, 0, 0]),  # all of them, watchdog 500 ms
    ],
)
def test_what_is_passive_anyway_may_be_written_without_control(side, table, address, words):
    assert side.write(VALVE, table, address, *words) == 0
    assert side.status() == INIT


@pytest.mark.parametrize(
    ("table", "address", "words"),
    [
        (Table.COILS, 0, [0, 1, 0]),
        (Table.HOLDING_REGISTERS, 2, [7]),
        (Table.HOLDING_REGISTERS, 4, [1]),
    ],
)
def test_what_is_a_command_needs_control(side, table, address, words):
    assert side.write(VALVE, table, address, *words) == 4
    assert side.status() == INIT


def test_the_watchdog_may_be_set_before_control_is_taken(side):
    assert side.write(VALVE, Table.HOLDING_REGISTERS, 3, 40) == 0
    assert (side.coil(CONTROL, 1), side.coil(ENABLE, 1)) == (0, 0)
    side.tick(count=38)  # the command came two ticks ago
    assert side.status() == ACTIVE | LOCAL
    side.tick(count=2)
    assert side.status() == FAULT_HOLD | LOCAL


def test_a_watchdog_that_is_written_again_as_it_was_is_no_command(active):
    for _ in range(49):
        assert active.write(VALVE, Table.HOLDING_REGISTERS, 3, 100) == 0
    assert active.status() == ACTIVE | LOCAL
    # By now 100 ms have passed since the valve was enabled.
    assert active.write(VALVE, Table.HOLDING_REGISTERS, 3, 100) == 0
    assert active.status() == FAULT_HOLD | LOCAL


def test_a_negative_watchdog_is_an_illegal_value(tmp_path):
    (tmp_path / "map.toml").write_text(
        '[device]\nprofile = "valve_408"\nvendor_name = "m"\nproduct_code = "c"\nrevision = "1"\n'
        '[holding_registers.watchdog]\naddress = 0\ntype = "int16"\nunit = "ms"\n'
        'source = "watchdog"\naccess = "rw"\n'
    )
    path = tmp_path / "bench.toml"
    path.write_text('[modbus.units.valve]\nregisters = "map.toml"\n')
    side = ModbusSide(load_config(path))
    assert side.write(VALVE, Table.HOLDING_REGISTERS, 0, 0xFFFF) == 3
    assert side.write(VALVE, Table.HOLDING_REGISTERS, 0, 5) == 0


def test_control_is_taken_before_what_needs_it_in_the_same_request(side):
    # Set-point 50 %, control word 7, control: the register of control is the last one.
    assert side.write(VALVE, Table.HOLDING_REGISTERS, 2, 7, 500, 5000, 1) == 0
    assert side.status() == ACTIVE | LOCAL
    side.tick(count=20)
    position = side.read(VALVE, Table.INPUT_REGISTERS, "spool_position_scaled")
    assert position == pytest.approx(50.0, abs=0.1)


@pytest.mark.parametrize("percent", [-100.0, -0.01, 0.0, 33.33, 100.0])
def test_the_set_point_as_an_integer(active, percent):
    raw = round(percent * 100) & 0xFFFF
    assert active.write(VALVE, Table.HOLDING_REGISTERS, 4, raw) == 0
    assert active.read(VALVE, Table.HOLDING_REGISTERS, "spool_setpoint") == pytest.approx(
        percent / 100,
        abs=0.5 / 16384,  # the device counts in 1/16384 of full opening
    )


@pytest.mark.parametrize("raw", [10001, 0x8000, -10001 & 0xFFFF])
def test_a_set_point_beyond_full_opening_is_an_illegal_value(active, raw):
    assert active.write(VALVE, Table.HOLDING_REGISTERS, 4, raw) == 3


def test_a_reset_without_a_fault_does_nothing(active):
    assert active.setpoint(0.25) == 0
    assert active.coil(RESET, 1) == 0
    assert active.status() == ACTIVE | LOCAL
    assert active.read(VALVE, Table.HOLDING_REGISTERS, "spool_setpoint") == 0.25


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
    with side.bench.faults.offset("pressure_a", 10e5):
        assert side.write(PRESSURE_A, Table.HOLDING_REGISTERS, 0, repeating_average, 200) == 0
        side.tick(count=2)
        assert side.read(PRESSURE_A, Table.INPUT_REGISTERS, "pressure") == before
        assert side.write(PRESSURE_A, Table.HOLDING_REGISTERS, 1, 200) == 0
        side.tick(count=2)
        after = side.read(PRESSURE_A, Table.INPUT_REGISTERS, "pressure")
    assert after == pytest.approx(before + 10.0, abs=0.01)


def test_the_bus_cannot_command_while_modbus_does(active):
    active.nmt(0x01)
    active.command(0x0000, 16384)
    assert active.status() == ACTIVE | LOCAL
    assert active.bench.commands[0] == 0.0


def test_nmt_stop_does_not_hold_a_valve_that_modbus_commands(active):
    active.nmt(0x02)
    assert active.status() == ACTIVE | LOCAL


def test_silence_is_a_fault_after_the_watchdog_time(active):
    assert active.write(VALVE, Table.HOLDING_REGISTERS, 3, 50) == 0
    assert active.setpoint(0.5) == 0
    # The set-point came two ticks ago.
    active.tick(count=48)
    assert active.status() == ACTIVE | LOCAL
    sent = active.tick(count=2)
    assert active.status() == FAULT_HOLD | LOCAL
    assert active.read(VALVE, Table.DISCRETE_INPUTS, "fault") == 1
    assert active.read(VALVE, Table.INPUT_REGISTERS, "error_code") == 0x8100
    # The emergency says it on CAN too.
    assert [frame.data[:2] for frame in sent if frame.can_id == 0x80 + VALVE] == [b"\x00\x81"]


def test_a_fault_is_reset_by_its_coil_and_leaves_the_valve_disabled(active):
    active.tick(count=200)
    assert active.status() == FAULT_HOLD | LOCAL
    assert active.coil(RESET, 0) == 0
    assert active.status() == FAULT_HOLD | LOCAL
    assert active.coil(RESET, 1) == 0
    assert active.status() == DISABLED | LOCAL
    assert active.read(VALVE, Table.INPUT_REGISTERS, "error_code") == 0
    assert active.coil(ENABLE, 1) == 0
    assert active.status() == ACTIVE | LOCAL
    assert active.read(VALVE, Table.HOLDING_REGISTERS, "spool_setpoint") == 0.0


def test_a_reset_takes_the_emergency_back(active):
    active.tick(count=200)
    active.log.clear()
    assert active.coil(RESET, 1) == 0
    errors = [frame.data[:2] for frame in active.log if frame.can_id == 0x80 + VALVE]
    assert errors == [b"\x00\x00"]


def test_a_reset_works_whatever_the_last_control_word_was(active):
    # It had the bit of the reset set, of which the device sees edges only.
    assert active.write(VALVE, Table.HOLDING_REGISTERS, 2, 0x000F) == 0
    active.tick(count=200)
    assert active.status() == FAULT_HOLD | LOCAL
    assert active.coil(RESET, 1) == 0
    assert active.status() == DISABLED | LOCAL


def test_control_that_is_taken_again_begins_with_set_point_0(active):
    assert active.setpoint(0.5) == 0
    for value in (0, 1):
        assert active.coil(CONTROL, value) == 0
    assert active.coil(ENABLE, 1) == 0
    assert active.status() == ACTIVE | LOCAL
    assert active.bench.commands[0] == 0.0


def test_a_watchdog_that_is_switched_on_counts_from_then(active):
    assert active.write(VALVE, Table.HOLDING_REGISTERS, 3, 0) == 0
    active.tick(count=500)
    assert active.write(VALVE, Table.HOLDING_REGISTERS, 3, 50) == 0
    active.tick(count=40)
    assert active.status() == ACTIVE | LOCAL
    active.tick(count=20)
    assert active.status() == FAULT_HOLD | LOCAL


def test_no_watchdog_means_no_fault(active):
    assert active.write(VALVE, Table.HOLDING_REGISTERS, 3, 0) == 0
    active.tick(count=500)
    assert active.status() == ACTIVE | LOCAL


def test_a_disabled_valve_takes_silence_for_no_fault(active):
    assert active.coil(ENABLE, 0) == 0
    active.tick(count=500)
    assert active.status() == DISABLED | LOCAL


def test_a_reset_of_the_node_ends_the_control_of_modbus(active):
    active.nmt(0x81, VALVE)
    active.tick(count=3)
    assert active.read(VALVE, Table.COILS, "control") == 0
    assert active.status() & 0x1F == INIT


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


@pytest.mark.parametrize(
    ("register", "message"),
    [
        (
            'type = "float32"\nsource = "position"',
            '.source: "position" is unknown; give an object or one of "pressure", "valid"',
        ),
        (
            'type = "float32"\nsource = "pressure"\nunit = "mm"',
            '.unit: "mm" does not fit; give one of "Pa", "mbar", "kPa", "bar", "MPa"',
        ),
        ('type = "uint16"\nsource = "0x7999"', ".source: object 0x7999.00 is not in "),
        ('type = "uint16"\nsource = "0x1008"', "; a number of at most 32 bits is right"),
        ('type = "uint16"\nsource = "0x61ZZ"', '"0x61ZZ" is no object'),
        (
            'type = "float32"\nsource = "pressure"\nunit = "bar"\naccess = "rw"',
            '.access: "pressure" cannot be written; give "r"',
        ),
        (
            'type = "float32"\nsource = "0x6130.01"\naccess = "rw"',
            '.access: "0x6130.01" cannot be written; give "r"',
        ),
    ],
)
def test_a_map_that_does_not_fit_its_device_is_refused(tmp_path, register, message):
    (tmp_path / "map.toml").write_text(f"{HEAD}[holding_registers.x]\naddress = 0\n{register}\n")
    path = tmp_path / "bench.toml"
    path.write_text('[modbus.units.pressure_a]\nregisters = "map.toml"\n')
    config = load_config(path)
    with pytest.raises(ConfigError) as caught:
        ModbusBinding(config, BusSide(config).bench)
    assert str(caught.value).startswith(f"{tmp_path}/map.toml:holding_registers.x.")
    assert message in str(caught.value)


def test_a_bench_without_modbus_has_no_binding():
    config = load_config()
    with pytest.raises(ConfigError, match=r"give \[modbus\]"):
        ModbusBinding(config, BusSide(config).bench)
