"""A valve that Modbus commands: control, watchdog, faults and their reset."""

import pytest
from support.bus_side import VALVE
from support.modbus_side import ACTIVE, CONTROL, DISABLED, ENABLE, FAULT_HOLD, INIT, LOCAL, RESET

from hil_bench.abilities.modbus.protocol.register_map import Table


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
