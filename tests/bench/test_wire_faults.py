"""Faults of copper on a whole bench: what nodes report, and what their controller sees."""

import can
import pytest

from hil_bench import ConfigError, VirtualBench, load_config
from hil_bench.abilities.copper.extension import Copper

WIRE = {"bus": {"bitrate": 125_000, "wire": {}}}
US = 1e-6


@pytest.fixture
def bench():
    with VirtualBench(load_config(tables=WIRE)) as b:
        b.run(0.02)
        b.bus.send(can.Message(arbitration_id=0, data=[1, 0], is_extended_id=False))
        b.run(0.1)
        yield b


def frames_of(bench, can_id, since=0.0):
    return [
        each for each in bench.frames if each.frame.can_id == can_id and each.now * 1e-9 >= since
    ]


def emcy_codes(bench, node_id):
    return [
        int.from_bytes(each.frame.data[:2], "little") for each in frames_of(bench, 0x80 + node_id)
    ]


def plug_of(bench, name):
    wiring = bench.bench.part(Copper).wiring
    return wiring.plugs[next(n for n in wiring.plugs if n.node_id == {"valve": 1}[name])]


def test_bus_off_and_back_is_told_by_8140_and_leaves_pre_operational(bench):
    begin = bench.now()
    with bench.faults.bus_off("valve"):
        bench.run(0.1)
        assert not frames_of(bench, 0x181, since=begin + 0.002)
        assert plug_of(bench, "valve").station.state == "bus-off"
    bench.run(0.2)
    assert emcy_codes(bench, 1) == [0x8140, 0x0000]
    # CiA 301, 0x1029.01: bus-off is a communication error, by default to PRE-OPERATIONAL.
    node = plug_of(bench, "valve").node
    assert node.state.name == "PRE_OPERATIONAL"
    (first, *_) = frames_of(bench, 0x081)
    assert first.frame.data[2] == 0x11  # generic and communication bits of the error register
    # 1408 bits of 8 us after the end of the fault at the earliest
    assert first.now * 1e-9 > begin + 0.1 + 1408 * 8 * US


def test_bit_errors_of_one_identifier_end_in_bus_off(bench):
    fault = bench.faults.bit_error("valve", can_id=0x181)
    bench.run(0.2)
    station = plug_of(bench, "valve").station
    assert station.errors >= 32
    fault.clear()
    bench.run(1.0)
    assert 0x8140 in emcy_codes(bench, 1)


def test_some_bit_errors_only_cost_time(bench):
    with bench.faults.bit_error("valve", 0.1):
        bench.run(3.0)
    errors, sent = plug_of(bench, "valve").station.errors, len(frames_of(bench, 0x181))
    assert 10 < errors < 80  # of some 300 frames
    assert 295 <= sent <= 315  # one each 10 ms: none is lost
    assert emcy_codes(bench, 1) == []


def test_a_pulled_plug_makes_the_node_passive_and_its_frames_come_afterwards(bench):
    with bench.faults.no_acknowledge("valve"):
        bench.run(0.1)
        station = plug_of(bench, "valve").station
        assert (station.tec, station.state) == (128, "error-passive")
        waiting = station.waiting
        assert waiting >= 9
    begin = bench.now()
    bench.run(0.1)
    assert len(frames_of(bench, 0x181, since=begin)) >= waiting
    assert emcy_codes(bench, 1)[0] == 0x8120
    assert emcy_codes(bench, 1)[-1] == 0x0000


def test_a_pulled_node_does_not_hear_either(bench):
    with bench.faults.no_acknowledge("valve"):
        bench.run(0.01)
        bench.bus.send(can.Message(arbitration_id=0, data=[2, 1], is_extended_id=False))
        bench.run(0.01)
    bench.run(0.1)
    assert plug_of(bench, "valve").node.state.name == "OPERATIONAL"


def test_a_dominant_bus_is_silent_and_comes_back(bench):
    with bench.faults.stuck_dominant("position"):
        begin = bench.now()
        bench.run(0.1)
        assert not [each for each in bench.frames if each.now * 1e-9 > begin + 0.002]
    bench.run(1.0)
    assert len(frames_of(bench, 0x182, since=begin + 0.1)) > 90
    assert 0x8120 in emcy_codes(bench, 2)


def test_a_noisy_bus_is_the_same_at_every_run():
    runs = []
    for _ in range(2):
        wire = {"bus": {"bitrate": 125_000, "wire": {"bit_error_rate": 1e-4}}}
        with VirtualBench(load_config(tables=wire, seed=5)) as b:
            b.run(1.0)
            runs.append((list(b.frames), b.bench.part(Copper).wiring.buses[0].wire.failed))
    assert runs[0] == runs[1]


def test_a_bus_that_takes_no_time_has_no_such_faults():
    with VirtualBench() as b, pytest.raises(ConfigError, match="give it"):
        b.faults.bus_off("valve")
    with pytest.raises(ConfigError, match=r"faults\[1\].*the bus of valve takes no time"):
        load_config(faults=[{"kind": "bus_off", "target": "valve"}])


def test_a_fault_of_a_file_acts_on_the_wire():
    faults = [{"kind": "bus_off", "target": "valve", "at_s": 0.05, "for_s": 0.01}]
    with VirtualBench(load_config(tables=WIRE, faults=faults)) as b:
        b.run(0.3)
        assert 0x8140 in emcy_codes(b, 1)
