"""J1939 devices on a bus of copper: each with a CAN controller of its own."""

from itertools import pairwise
from pathlib import Path

import can
import pytest

from hil_bench import ConfigError, VirtualBench, load_config
from hil_bench.abilities.copper.extension import Copper
from hil_bench.abilities.eyes.traffic import worst_bits

EXAMPLE = Path(__file__).parents[2] / "examples" / "j1939.toml"
WIRE = {"bus": {"bitrate": 125_000, "wire": {}}}
BIT = 8_000
JOYSTICK, PRESSURES, COMMAND = 0x0CFDD613, 0x18FF108C, 0x0CFE3027


def on_wire(**further):
    return VirtualBench(load_config(EXAMPLE, tables={**WIRE, **further}))


@pytest.fixture
def bench():
    with on_wire() as bench:
        bench.run(0.4)
        yield bench


def plug_of(bench, name):
    return bench.bench.part(Copper).wiring.plugs[bench.ecus[name].ecu]


def frames_of(bench, can_id, since=0.0):
    return [
        each for each in bench.frames if each.frame.can_id == can_id and each.now * 1e-9 >= since
    ]


def test_each_device_has_a_controller_of_its_own(bench):
    names = ["valve", "joystick", "sensors"]
    stations = [plug_of(bench, name).station for name in names]

    assert [station.name for station in stations] == names
    assert len({id(station) for station in stations}) == 3
    assert {plug_of(bench, name).standing()["state"] for name in names} == {"error-active"}


def test_frames_of_one_tick_pass_one_after_the_other(bench):
    """All claim at power-on; the identifiers differ by the address alone, and the lowest wins."""
    claims = [each for each in bench.frames if each.frame.can_id & 0xFFFFFF00 == 0x18EEFF00][:3]

    assert [each.frame.can_id & 0xFF for each in claims] == [19, 128, 140]
    gaps = [after.now - before.now for before, after in pairwise(claims)]
    # Without stuff bits a frame of 29 bits and 8 bytes has 64 + 64 + 3 bits.
    assert all(131 * BIT <= gap <= 160 * BIT for gap in gaps)
    assert worst_bits(8) < 160


def test_devices_hear_each_other_and_not_themselves():
    """Two devices with one address after a fault: each hears the other's claim, not its own."""
    with on_wire() as bench:
        bench.run(0.4)
        with bench.faults.readdress("joystick", 128):
            bench.run(0.1)
        assert (2128, 31) in bench.ecus["valve"].trouble_codes
        assert bench.ecus["joystick"].trouble_codes == []
        assert bench.ecus["sensors"].trouble_codes == []


def test_the_valve_obeys_what_has_passed(bench):
    data = bytes.fromhex("7d ff 01 ff ff ff ff ff")
    bench.bus.send(can.Message(arbitration_id=COMMAND, data=data, is_extended_id=True))
    assert bench.values["axis1.spool_setpoint"] == 0.0
    bench.run(0.005)  # a frame takes up to 1.3 ms, behind up to three others

    assert bench.values["axis1.spool_setpoint"] == 0.5


def test_bus_off_silences_one_device_alone(bench):
    begin = bench.now()
    with bench.faults.bus_off("joystick"):
        bench.run(0.3)
        assert plug_of(bench, "joystick").station.state == "bus-off"
        assert not frames_of(bench, JOYSTICK, since=begin + 0.002)
        assert frames_of(bench, PRESSURES, since=begin + 0.1)
        assert plug_of(bench, "sensors").station.state == "error-active"
    bench.run(0.3)  # 128 times 11 bits of 8 us are 11.3 ms

    assert frames_of(bench, JOYSTICK, since=begin + 0.32)


def test_an_address_is_claimed_again_after_bus_off(bench):
    """Nobody could hear who claimed it meanwhile."""
    claims = 0x18EEFF13
    before = len(frames_of(bench, claims))
    with bench.faults.bus_off("joystick"):
        bench.run(0.3)
        assert len(frames_of(bench, claims)) == before
    back = bench.now()
    bench.run(0.1)

    (again,) = frames_of(bench, claims)[before:]
    # 128 times 11 bits of 8 us are 11.3 ms; then a tick, and behind its 15 messages that have
    # waited and those of the others, each of 160 bits at most.
    assert 0.0113 < again.now * 1e-9 - back < 0.0113 + 0.001 + 20 * 160 * BIT * 1e-9
    assert bench.ecus["joystick"].address == 19


def test_a_device_whose_address_was_taken_meanwhile_takes_another(bench):
    """Address 128 is one of those that a device claims and waits for contention."""
    with bench.faults.bus_off("valve"):
        bench.run(0.1)
    bench.run(0.05)  # it has claimed 128 again, and waits
    smaller = can.Message(arbitration_id=0x18EEFF80, data=bytes(8), is_extended_id=True)
    bench.bus.send(smaller)
    bench.run(0.4)

    assert bench.ecus["valve"].address == 129


def test_bit_errors_count_for_the_sender(bench):
    with bench.faults.bit_error("sensors", 0.2):
        bench.run(2.0)

    assert plug_of(bench, "sensors").station.errors > 0
    assert plug_of(bench, "joystick").station.errors == 0


def test_a_full_buffer_loses_and_counts_the_frames_of_its_device():
    tables = {"bus": {"bitrate": 125_000, "wire": {"buffer_frames": 1}}}
    with VirtualBench(load_config(EXAMPLE, tables=tables)) as bench:
        bench.run(0.4)
        before = plug_of(bench, "joystick").station.refused  # a claim and a message of one tick
        assert plug_of(bench, "valve").station.refused == 0
        with bench.faults.bus_off("valve"):
            bench.run(0.5)  # the message of 0.4 s has room, the five behind it have none
        assert plug_of(bench, "valve").station.refused == 5
        assert plug_of(bench, "joystick").station.refused == before


def test_without_copper_such_a_fault_is_refused():
    faults = [{"kind": "bus_off", "target": "joystick", "at_s": 0.1}]
    with pytest.raises(ConfigError, match="the bus of joystick takes no time; give it"):
        load_config(EXAMPLE, faults=faults)


def test_the_buffer_of_a_device_may_be_given():
    wire = {"stations": {"joystick": {"buffer_frames": 3}}}
    config = load_config(EXAMPLE, tables={"bus": {"bitrate": 125_000, "wire": wire}})
    with VirtualBench(config) as bench:
        assert plug_of(bench, "joystick").station.depth == 3
