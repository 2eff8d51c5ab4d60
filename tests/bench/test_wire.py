"""A bench whose bus is of copper: frames take their time, to the bit."""

import can
import pytest

from hil_bench import ConfigError, VirtualBench, load_config
from hil_bench.abilities.copper.extension import Copper
from hil_bench.abilities.copper.wire.bits import exact_bits
from hil_bench.canopen_device.frame import Frame

US = 1000
MS = 1_000_000
BOOT = 0x700


def bench(bitrate=125_000, **wire):
    return VirtualBench(load_config(tables={"bus": {"bitrate": bitrate, "wire": wire}}))


def send(bench, can_id, data=b""):
    bench.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))


def test_boot_up_messages_come_one_after_the_other():
    with bench() as b:
        b.run(0.01)
        logged = [each for each in b.frames if each.frame.can_id > BOOT]
    times = []
    end = MS  # the tick in which all boot
    for node_id in (1, 2, 3, 4):
        end += 8 * US * exact_bits(Frame(BOOT + node_id, b"\0"))
        times.append(end)
    assert [each.now for each in logged] == times
    assert [each.frame.can_id for each in logged] == [BOOT + n for n in (1, 2, 3, 4)]


def test_a_request_and_its_answer_take_their_time_and_a_tick():
    request = bytes.fromhex("4000100000000000")
    with bench() as b:
        b.run(0.0104)
        while b.bus.recv(0.0):
            pass  # boot-up messages
        send(b, 0x601, request)  # between two ticks
        answer = b.bus.recv(0.1)
        passed = 10_400 * US + 8 * US * exact_bits(Frame(0x601, request))
        tick = -(-passed // MS) * MS  # the node looks once a tick
        assert answer.arbitration_id == 0x581
        bits = exact_bits(Frame(0x581, bytes(answer.data)))
        assert answer.timestamp == pytest.approx((tick + 8 * US * bits) * 1e-9, abs=1e-12)
        assert b.now() == answer.timestamp  # the reader gets it then, not with the next tick


def test_nodes_hear_each_other_when_the_frame_has_passed():
    """The valve watches the heartbeat of a sensor that boots: EMCY 0x8130 needs its frame."""
    with bench(bitrate=10_000) as b:
        b.run(0.002)
        assert not list(b.frames)  # 59 bits or more of 100 us each have not passed yet
        b.run(0.006)
        (first,) = b.frames
        assert first.frame.can_id == 0x701


def test_a_full_buffer_is_an_error_of_the_controller_and_counted():
    with bench(stations={"controller": {"buffer_frames": 2}}) as b:
        b.run(0.1)
        send(b, 0x600)
        send(b, 0x600)
        with pytest.raises(can.CanOperationError, match="transmission buffer is full"):
            send(b, 0x600)
        (bus,) = b.bench.part(Copper).wiring.buses.values()
        assert bus.controller.refused == 1


def test_a_node_whose_buffer_is_full_reports_objects_lost():
    """EMCY 0x8110 (CiA 301), communication bit 4 and generic bit 0 of the error register."""
    with bench(bitrate=10_000, stations={"valve": {"buffer_frames": 2}}) as b:
        b.run(0.2)
        for _ in range(3):  # answers of 110 bits a tick of 1 ms, where one takes 11 ms
            send(b, 0x601, bytes.fromhex("4000100000000000"))
        send(b, 0x000, b"\x01\x00")
        b.run(3.0)
        codes = [each.frame.data[:3].hex() for each in b.frames if each.frame.can_id == 0x081]
        assert "108111" in codes


def test_the_second_bus_may_be_of_copper_and_the_first_not():
    tables = {
        "buses": {"slow": {"bitrate": 20_000, "wire": {}}},
        "nodes": {
            "io": {"profile": "encoder_406", "node_id": 1},
            "far": {"profile": "encoder_406", "node_id": 1, "bus": "slow"},
            "valve": {"profile": "valve_408", "node_id": 2},
        },
    }
    with VirtualBench(load_config(tables=tables)) as b:
        b.run(0.01)
        times = {each.frame.bus: each.now for each in b.frames if each.frame.can_id == 0x701}
    assert times == {0: MS, 1: MS + 50 * US * exact_bits(Frame(0x701, b"\0"))}


@pytest.mark.parametrize(
    ("wire", "message"),
    [
        (3, "bus.wire: 3 is not a table; write it as [bus.wire]"),
        ({"buffer_frames": 0}, "bus.wire.buffer_frames: 0 is out of range"),
        ({"order": "lifo"}, 'bus.wire.order: "lifo"'),
        ({"stations": {"pump": {}}}, "bus.wire.stations.pump: is no node of this bus; give one of"),
        ({"stations": 1}, "bus.wire.stations: 1 is not a table"),
    ],
)
def test_a_wrong_table_is_one_line(wire, message):
    with pytest.raises(ConfigError) as caught:
        load_config(tables={"bus": {"wire": wire}})
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_lock_step_is_refused():
    from hil_bench.abilities.lockstep.lockstep import LockStep  # noqa: PLC0415

    with bench() as b, pytest.raises(ConfigError, match="lock-step"):
        LockStep(b.session, tick_ns=MS)


def test_what_comes_from_outside_with_a_nodes_identifier_is_counted_and_its_own_is_not():
    with bench() as b:
        b.run(0.02)
        send(b, BOOT + 1, b"\0")
        b.run(0.01)
        assert [node.counters.foreign_frames for node in b.bench.nodes] == [1, 0, 0, 0]
