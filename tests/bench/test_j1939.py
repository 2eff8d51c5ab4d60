"""A valve driver and devices by table on J1939, as a controller on the bus meets them."""

import math
from pathlib import Path

import can
import pytest

from hil_bench import ConfigError, VirtualBench, load_config
from hil_bench.abilities.j1939.protocol.signals import split

EXAMPLE = Path(__file__).parents[2] / "examples" / "j1939.toml"
COMMAND, FLOW = 0x0CFE3027, 0xFE10


@pytest.fixture
def bench():
    with VirtualBench(load_config(EXAMPLE)) as bench:
        bench.run(0.3)
        yield bench


def command(bench, data, *, times=1):
    for _ in range(times):
        message = can.Message(arbitration_id=COMMAND, data=bytes.fromhex(data), is_extended_id=True)
        bench.bus.send(message)
        bench.run(0.1)


def latest(bench, group):
    frames = [
        each.frame for each in bench.frames if each.frame.is_extended and not each.is_received
    ]
    return [frame.data.hex(" ") for frame in frames if split(frame.can_id).group == group][-1]


@pytest.mark.parametrize(
    ("data", "spool", "flow"),
    # Flow 0.4 % a bit: 0x7D = 125 is 50 %; state 1 extends, 2 retracts. Flow back: 1 % a bit
    # from -125: 175 = 0xAF is 50 %, 75 = 0x4B is -50 %. The upper bits of byte 3 are reserved.
    [("7d ff 01", 0.5, "af 4b 31"), ("7d ff 02", -0.5, "4b af 32"), ("fa ff 00", 0.0, "7d 7d 30")],
)
def test_a_command_moves_the_spool_and_the_flow_comes_back(bench, data, spool, flow):
    command(bench, data, times=10)

    assert bench.values["axis1.spool_position"] == pytest.approx(spool, abs=0.005)
    assert latest(bench, FLOW) == f"{flow} 1f c0 ff ff ff"


def test_without_a_command_for_300_ms_the_spool_goes_back(bench):
    command(bench, "7d ff 01", times=3)
    bench.run(0.19)  # 290 ms after the last
    assert bench.values["axis1.spool_setpoint"] == 0.5
    bench.run(0.2)

    assert bench.values["axis1.spool_setpoint"] == 0.0
    assert bench.ecus["valve"].trouble_codes == [(1907, 9)]
    assert latest(bench, FLOW)[12:14] == "c5"  # reason 5: time-out
    command(bench, "00 ff 00", times=12)
    assert bench.ecus["valve"].trouble_codes == []


@pytest.mark.parametrize("data", ["ff ff 01", "fe ff 01", "7d ff 03", "7d ff 0e", "fb ff 02"])
def test_an_invalid_command_blocks(bench, data):
    command(bench, "7d ff 01")
    command(bench, data)

    assert bench.values["axis1.spool_setpoint"] == 0.0
    assert latest(bench, FLOW)[12:14] in {"c0", "c6"}


def test_a_signal_shows_the_plant(bench):
    raw = bytes.fromhex(latest(bench, 0xFF10))
    pressure = bench.values["sensors.pressure_a.measured"]

    # 0.005 bar a bit
    assert int.from_bytes(raw[:2], "little") * 500.0 == pytest.approx(pressure, abs=300.0)
    assert pressure == bench.values["axis1.P_A"]


def test_a_test_sets_what_nothing_else_moves(bench):
    bench.ecus["joystick"]["button_1"] = 1
    bench.run(0.05)

    assert bytes.fromhex(latest(bench, 0xFDD6))[5] >> 6 == 1
    with pytest.raises(ConfigError, match="x is what the device itself shows"):
        bench.ecus["joystick"]["x"] = 1
    with pytest.raises(ConfigError, match='no signal "y"'):
        bench.ecus["joystick"]["y"] = 1
    with pytest.raises(ConfigError, match='no device "lever"'):
        bench.ecus["lever"]


def test_a_broken_wire_shows_the_error_indicator_and_raises_a_code(bench):
    with bench.faults.break_wire("joystick.x"):
        bench.run(0.05)
        assert math.isnan(bench.ecus["joystick"]["x"])
        assert latest(bench, 0xFDD6)[:5] == "aa ff"
        assert latest(bench, 0xFECA) == "04 ff 64 0a 02 01 ff ff"  # SPN 2660 = 0xA64, FMI 2


def test_a_signal_is_not_available(bench):
    with bench.faults.indicate("joystick.x", "not_available"):
        bench.run(0.05)
        assert bytes.fromhex(latest(bench, 0xFDD6))[1] == 0xFF
        assert bench.ecus["joystick"].trouble_codes == []


def test_a_fault_reports_a_code(bench):
    with bench.faults.report("valve", spn=1208, fmi=3, lamp="stop"):
        bench.run(0.01)
        assert latest(bench, 0xFECA) == "10 ff b8 04 03 01 ff ff"


def test_a_device_off_the_bus_says_nothing_and_claims_again(bench):
    def sent():
        frames = (each.frame for each in bench.frames)
        return [frame.can_id for frame in frames if frame.can_id & 0xFF == 19]

    with bench.faults.reset("joystick", duration=0.2):
        before = len(sent())
        bench.run(0.19)
        assert len(sent()) == before
        bench.run(0.05)
    assert sent()[before] == 0x18EEFF13


def test_a_wrong_address_is_an_address_violation_for_its_owner(bench):
    with bench.faults.readdress("joystick", 128):
        bench.run(0.05)

    assert 0x0CFDD680 in {each.frame.can_id for each in bench.frames}
    assert (2128, 31) in bench.ecus["valve"].trouble_codes


def test_a_signal_of_a_device_may_command_an_axis(make_file):
    lever = "pgn = 0xFF20, start_bit = 0, length = 8, resolution = 1.0, offset = -125.0"
    path = make_file(
        "bench.toml",
        "[j1939.lever]\naddress = 10\n[j1939.lever.signals]\n"
        f"x = {{ {lever}, rate_ms = 10, constant = 25 }}\n"
        "[j1939.driver]\naddress = 11\n[j1939.driver.signals]\n"
        f'x = {{ {lever}, sink = "axis1.spool_setpoint", unit = "%" }}\n',
    )
    with VirtualBench(load_config(path)) as bench:
        bench.run(0.05)
        assert bench.values["axis1.spool_setpoint"] == pytest.approx(0.25)
        bench.ecus["lever"]["x"] = math.nan
        bench.run(0.05)
        assert bench.values["axis1.spool_setpoint"] == 0.0


def test_canopen_and_j1939_share_the_bus(bench):
    kinds = {each.frame.is_extended for each in bench.frames}

    assert kinds == {True, False}
    assert bench.bench.nodes[0].state.name == "PRE_OPERATIONAL"
