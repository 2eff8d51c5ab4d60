"""A PLC that knows nothing of this bench commands it by the built-in register maps.

It polls as the OpenPLC runtime does: all areas of all devices, all outputs in every cycle, each
100 ms. There must be no exception, for which it would close the connection, and no fault.
"""

import struct

import pytest
from support.openplc import openplc, run_openplc

from hil_bench import VirtualBench, load_config

VALVE, PRESSURE_A, PRESSURE_B, POSITION = 1, 2, 3, 4
UNITS = """
[modbus.units.valve]
commands = true
{extra}
[modbus.units.pressure_a]
{extra}
[modbus.units.pressure_b]
{extra}
[modbus.units.position]
{extra}
"""
CONTROL, ENABLE = 0, 1  # coils
CONTROL_WORD, WATCHDOG, SCALED, CONTROL_REGISTER = 2, 3, 4, 5  # holding registers
ACTIVE = 0

WHOLE_MAPS = {
    VALVE: {
        "discrete_inputs": 2,
        "coils": 3,
        "input_registers": 10,
        "holding_read": 6,
        "holding": 6,
    },
    PRESSURE_A: {
        "discrete_inputs": 3,
        "coils": 1,
        "input_registers": 8,
        "holding_read": 4,
        "holding": 4,
    },
    PRESSURE_B: {"discrete_inputs": 3, "coils": 1, "input_registers": 8},
    POSITION: {"discrete_inputs": 1, "input_registers": 9, "holding_read": 3, "holding": 3},
}
EIGHT_OF_EACH = {  # the sizes that its form for a new device suggests
    unit_id: {
        "discrete_inputs": 8,
        "coils": 8,
        "input_registers": 9 if unit_id == POSITION else 8,  # 8 would cut a value in two
        "holding_read": 8,
        "holding": 8,
    }
    for unit_id in (VALVE, PRESSURE_A, PRESSURE_B, POSITION)
}


def position_of(devices):
    """Position [m], as the program has it: two words, in micrometres."""
    high, low = devices[POSITION].inputs[7:9]
    return struct.unpack(">i", struct.pack(">2H", high, low))[0] * 1e-6


def by_coils_and_integers(valve, fraction):
    valve.coils[CONTROL] = valve.coils[ENABLE] = True
    valve.holding[SCALED] = round(fraction * 10000)


def by_coils_and_floats(valve, fraction):
    valve.coils[CONTROL] = valve.coils[ENABLE] = True
    valve.holding[:2] = struct.unpack(">2H", struct.pack(">f", fraction))


def by_registers_alone(valve, fraction):
    valve.holding[CONTROL_REGISTER], valve.holding[CONTROL_WORD] = 1, 7
    valve.holding[SCALED] = round(fraction * 10000)


@pytest.mark.parametrize(
    "command", [by_coils_and_integers, by_coils_and_floats, by_registers_alone]
)
@pytest.mark.parametrize(
    ("sizes", "extra", "watchdog"),
    [(WHOLE_MAPS, "", 0), (EIGHT_OF_EACH, 'holes = "zero"', 500)],
    ids=["maps", "eight"],
)
def test_it_moves_the_axis_without_an_exception_or_a_fault(
    make_file, sizes, extra, command, watchdog
):
    path = make_file("bench.toml", UNITS.format(extra=extra))
    with VirtualBench(load_config(path)) as bench:
        bench.run(0.01)  # before the first tick there are no values
        devices = openplc(bench, sizes)
        for unit_id in (PRESSURE_A, PRESSURE_B):
            if devices[unit_id].holding:
                devices[unit_id].holding[1] = 1  # the filter's constant, which must not be 0
        was_active = []

        def program(devices):
            valve = devices[VALVE]
            valve.holding[WATCHDOG] = watchdog
            if bench.now() < 0.5:
                return  # the PLC has started, and its program commands nothing yet
            command(valve, 0.5 if position_of(devices) < 0.05 else 0.0)
            was_active.append(valve.bits[ACTIVE])

        run_openplc(bench, devices, program, 3.0)
        assert [device.refused for device in devices.values()] == [[], [], [], []]
        assert [device.opened for device in devices.values()] == [1, 1, 1, 1]
        assert all(was_active[2:])  # from the cycle on that shows the one of the first command
        assert len(was_active) > 20
        assert position_of(devices) > 0.05
        assert bench.values["axis1.position"] == pytest.approx(position_of(devices), abs=1e-3)
        errors = [frame for frame in bench.frames if frame.frame.can_id == 0x80 + VALVE]
        assert errors == []


def test_a_plc_that_stops_leaves_a_valve_that_watches_it(make_file):
    path = make_file("bench.toml", UNITS.format(extra=""))
    with VirtualBench(load_config(path)) as bench:
        bench.run(0.01)
        devices = openplc(bench, WHOLE_MAPS)
        devices[PRESSURE_A].holding[1] = 1
        devices[VALVE].holding[WATCHDOG] = 500

        def program(devices):
            by_coils_and_integers(devices[VALVE], 0.3)

        run_openplc(bench, devices, program, 1.0)
        assert devices[VALVE].bits == [True, False]
        bench.run(0.6)
        devices[VALVE].poll()
        assert devices[VALVE].bits == [False, True]
