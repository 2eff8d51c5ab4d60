"""Parts of a bus of copper by hand: its table, its error frames, what it counts and measures."""

import math
from itertools import pairwise

import can
import pytest

from hil_bench import ConfigError, VirtualBench, load_config
from hil_bench.abilities.copper.extension import Copper
from hil_bench.abilities.copper.measured_traffic import measure_traffic
from hil_bench.abilities.copper.section import _gaps
from hil_bench.abilities.copper.wire.attempt import Broken, ErrorKind
from hil_bench.abilities.copper.wire.bits import exact_bits
from hil_bench.abilities.copper.wire.error_frames import broken_frame, event_frame
from hil_bench.abilities.copper.wire.station import Order, Station
from hil_bench.abilities.copper.wire.wire import ErrorFrame
from hil_bench.canopen_device.emcy import CanEvent
from hil_bench.canopen_device.frame import Frame
from hil_bench.devices.measurement.low_pass import random_stream
from hil_bench.frame import ERROR_FLAG

MS = 1_000_000
BIT = 8_000  # ns at 125 kbit/s


# linux/can/error.h: CRTL 4, PROT 8, ACK 0x20, BUSOFF 0x40, BUSERROR 0x80, RESTARTED 0x100,
# CNT 0x200; data[1] RX_PASSIVE 0x10, TX_PASSIVE 0x20, ACTIVE 0x40; data[2] BIT 1, STUFF 4,
# BIT0 8, TX 0x80; data[6] and [7] are the counters, of 8 bits.
@pytest.mark.parametrize(
    ("what", "counters", "classes", "data"),
    [
        ((ErrorKind.BIT, True), (8, 0), 0x288, "00 00 81 00 00 00 08 00"),
        ((ErrorKind.BIT, False), (0, 9), 0x288, "00 00 04 00 00 00 00 09"),
        ((ErrorKind.STUFF, True), (8, 3), 0x288, "00 00 81 00 00 00 08 03"),
        ((ErrorKind.ACK, True), (127, 0), 0x2A8, "00 00 81 00 00 00 7f 00"),
        ((ErrorKind.ACK, False), (0, 1), 0x288, "00 00 04 00 00 00 00 01"),
        ((ErrorKind.DOMINANT, True), (1, 0), 0x288, "00 00 89 00 00 00 01 00"),
        ((ErrorKind.DOMINANT, False), (0, 1), 0x288, "00 00 0c 00 00 00 00 01"),
        (CanEvent.BUS_OFF, (256, 255), 0x240, "00 00 00 00 00 00 ff ff"),
        (CanEvent.RECOVERED, (0, 0), 0x300, "00 00 00 00 00 00 00 00"),
        (CanEvent.ACTIVE, (127, 127), 0x204, "00 40 00 00 00 00 7f 7f"),
        (CanEvent.PASSIVE, (128, 127), 0x204, "00 20 00 00 00 00 80 7f"),
        (CanEvent.PASSIVE, (127, 128), 0x204, "00 10 00 00 00 00 7f 80"),
        (CanEvent.PASSIVE, (254, 254), 0x204, "00 30 00 00 00 00 fe fe"),
        (CanEvent.OVERRUN, (0, 0), None, ""),
        (CanEvent.SENT_ALL, (0, 0), None, ""),
    ],
)
def test_an_error_has_the_layout_of_socketcan(what, counters, classes, data):
    adapter, other = Station("a", 1), Station("b", 1)
    adapter.tec, adapter.rec = counters
    if isinstance(what, CanEvent):
        found = event_frame(what, adapter, 2)
    else:
        kind, is_own = what
        error = ErrorFrame(Broken(kind, 1, 2), Frame(1), adapter if is_own else other, 0, 1)
        found = broken_frame(error, adapter, 2)
    expected = None if classes is None else Frame(ERROR_FLAG | classes, bytes.fromhex(data), bus=2)
    assert found == expected


def wired(wire, **bus):
    return load_config(tables={"bus": {"wire": wire, **bus}})


def bus_of(bench):
    return bench.bench.part(Copper).wiring.buses[0]


def test_a_wire_has_the_numbers_of_its_table_and_256_sorted_frames_without_one():
    stations = {"valve": {"buffer_frames": 3, "order": "fifo"}}
    table = {"buffer_frames": 7, "recovery_ms": 2.5, "stations": stations}
    with VirtualBench(wired(table, bitrate=50_000)) as bench:
        wire = bus_of(bench).wire
        kept = {each.name: (each.depth, each.order) for each in wire.stations}
        assert (wire.bitrate, wire.make_end()._recovery) == (50_000, 2_500_000)
        assert wire._data_bitrate == 50_000
    assert kept.pop("valve") == (3, Order.FIFO)
    assert kept.pop("babbling node") == (1000, Order.PRIORITY)
    assert set(kept.values()) == {(7, Order.PRIORITY)}
    with VirtualBench(wired({})) as bench:
        wire = bus_of(bench).wire
        assert (wire.bitrate, wire.make_end()._recovery) == (1_000_000, 0)
        assert bus_of(bench).controller.depth == 256
        assert bus_of(bench).controller.order is Order.PRIORITY


@pytest.mark.parametrize(
    ("key", "right", "wrong"),
    [
        ("buffer_frames", (1, 100_000), (0, 100_001)),
        ("bit_error_rate", (0, 0.01), (-1e-9, 0.010_001)),
        ("recovery_ms", (0, 3.6e6), (-1e-9, 3.600_001e6)),
    ],
)
def test_a_wire_takes_its_limits_and_nothing_beyond(key, right, wrong):
    for value in right:
        wired({key: value})
        wired({"stations": {"valve": {}}, key: value})
    for value in wrong:
        with pytest.raises(ConfigError, match=rf"^built-in bench:bus\.wire\.{key}: .*out of range"):
            wired({key: value})


def test_gaps_between_disturbed_bits_are_those_of_a_rate():
    assert [_gaps(random_stream(1, "bus", "x"), 1.0)() for _ in range(3)] == [0, 0, 0]
    draw = _gaps(random_stream(1, "bus", "x"), 0.2)
    gaps = [draw() for _ in range(4000)]
    assert min(gaps) == 0
    # Geometric: the mean is (1 - p) / p, the deviation sqrt(1 - p) / p.
    assert math.fsum(gaps) / 4000 == pytest.approx(4.0, abs=4 * math.sqrt(0.8) / 0.2 / 63)


def test_lines_count_what_passed_failed_and_was_lost():
    with VirtualBench(wired({}, bitrate=125_000)) as bench:
        copper, bus = bench.bench.part(Copper), bus_of(bench)
        bench.run(0.02)
        passed, failed = bus.wire.passed, bus.wire.failed
        assert copper.lines(["x"]) == [f"wire      x: {passed} frames passed, {failed} failed"]
        bus.controller.refused = 2
        plugs = [plug.station for plug in copper.wiring.plugs.values()]
        plugs[0].errors, plugs[1].refused, plugs[2].rec, plugs[3].tec = 1, 2, 3, 4
        names = [station.name for station in plugs]
        assert copper.lines(["x"]) == [
            f"wire      x: {passed} frames passed, {failed} failed, 2 of the controller lost",
            f"          {names[0]}: error-active TEC 0 REC 0, 1 repeated",
            f"          {names[1]}: error-active TEC 0 REC 0, 2 lost in a full buffer",
            f"          {names[2]}: error-active TEC 0 REC 3",
        ]


def test_ten_thousand_errors_are_kept_for_a_tick_and_no_more():
    with VirtualBench(wired({})) as bench:
        wiring, bus = bench.bench.part(Copper).wiring, bus_of(bench)
        error = ErrorFrame(Broken(ErrorKind.BIT, 1, 2), Frame(1), bus.babbler, 0, 5)
        for _ in range(9_999):
            bus.wire.on_error(error)
        bus.wire.on_event(bus.controller, CanEvent.RECOVERED)
        bus.wire.on_event(bus.controller, CanEvent.RECOVERED)
        bus.wire.on_error(error)
        errors = wiring.take_errors()
        assert (len(errors), wiring.take_errors()) == (10_000, [])
        assert errors[0][1] == 5
        assert errors[-1] == (Frame(ERROR_FLAG | 0x300, bytes(8)), bus.wire.free_at)


@pytest.mark.parametrize(
    ("direction", "sides"),
    [(None, (1, 0)), ("sent", (1, 0)), ("received", (0, 1)), ("both", (1, 1))],
)
def test_bit_errors_have_a_direction_and_end(direction, sides):
    given = {} if direction is None else {"direction": direction}
    with VirtualBench(wired({})) as bench:
        wiring = bench.bench.part(Copper).wiring
        plug = next(each for each in wiring.plugs.values() if each.station.name == "valve")
        station, ruled = plug.station, plug.wire
        with bench.faults.bit_error("valve", 0.0, **given):
            bench.run(0.002)
            assert (len(station.send_rules), len(station.receive_rules)) == sides
            assert ruled._ruled == [station] * sides[1]
        bench.run(0.002)
        assert (station.send_rules, station.receive_rules, ruled._ruled) == ([], [], [])
        for share in (-0.001, 1.001):
            with pytest.raises(ConfigError, match="share"):
                bench.faults.bit_error("valve", share)


def test_traffic_is_measured_frame_by_frame():
    """A sensor that sends nothing; the controller sends NMT, SYNC, an RPDO, and one of others."""
    silent = {"0x1017.00": 0, "0x1800.01": 0xC000_0182}
    nodes = {
        "valve": {"profile": "valve_408", "node_id": 1},
        "io": {"profile": "encoder_406", "node_id": 2, "bus": "side", "objects": silent},
    }
    config = load_config(tables={"buses": {"side": {}}, "nodes": nodes})
    frames = [Frame(0, b"\1\0", bus=1), Frame(0x80), Frame(0x202, bytes(8)), Frame(0x300)]
    bits = [exact_bits(frame) for frame in frames]
    ends = [BIT * sum(bits[: count + 1]) for count in range(4)]
    ids = [frame.can_id for frame in frames]

    def measured(duration, bitrate=125_000):
        return measure_traffic(
            config, "side", frames[1:3], cycle=10 * MS, bitrate=bitrate, duration=duration,
            others=[(frames[3], 100 * MS)],
        )  # fmt: skip

    # The tick of 2000 ms has what others send, and SYNC is due at 2002 ms: 2 ms late by then.
    found = measured(2001 * MS)
    assert found.counts == dict(zip(ids, (1, 200, 200, 20), strict=True))
    assert found.worst == dict(zip(ids, ends, strict=True))  # all at once in the first cycle
    counts = (1, 200, 200, 20)
    assert found.busy == BIT * sum(count * each for count, each in zip(counts, bits, strict=True))
    assert found.waiting == 1  # that of 2000 ms begins with the next tick
    # At 10 kbit/s frames of a cycle take 17.6 ms: every second RPDO waits.
    slow = measured(100 * MS, 10_000)
    assert slow.waiting > 5
    assert all(late >= early for early, late in pairwise(slow.worst[each] for each in ids[1:3]))


def test_each_frame_is_logged_at_its_end_and_as_coming_from_its_side():
    with VirtualBench(wired({}, bitrate=125_000)) as bench:
        bench.bus.send(can.Message(arbitration_id=0x7F0, is_extended_id=False))
        bench.run(0.01)
        logged = list(bench.frames)
    outside = [(each.frame, each.now) for each in logged if each.is_received]
    assert outside == [(Frame(0x7F0), BIT * exact_bits(Frame(0x7F0)))]
    assert [each.frame.can_id for each in logged if not each.is_received] == [
        0x701,
        0x702,
        0x703,
        0x704,
    ]
