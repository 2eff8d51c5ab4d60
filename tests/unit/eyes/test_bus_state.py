"""The present state of a bus, frame by frame; and two recordings of it told from one."""

import math
from itertools import pairwise
from statistics import median

import pytest

from device_profiles import PRESSURE_404
from hil_bench.abilities.eyes.bus_state import EXTENDED, FIRST_FD, BusState
from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.explain.recordings import Recordings
from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.frame import FDF, Frame
from hil_bench.frame import bits_of
from hil_bench.outside.recording.channels import LoggedFrame

MS = 1_000_000


def state_of(*frames, known=(), bitrate=10_000, speedup=1.0):
    """Take frames at their times [ms]."""
    state = BusState(Decoder(known), bitrate, speedup)
    for now, frame in frames:
        state.take(LoggedFrame(frame, round(now * MS), None))
    return state


def beats(*times, node_id=5, data=b"\5"):
    return [(now, Frame(0x700 + node_id, data)) for now in times]


def emcy(code, register=1, node_id=5):
    return Frame(0x80 + node_id, code.to_bytes(2, "little") + bytes([register, *bytes(5)]))


def test_streams_are_counted_with_their_times():
    frames = [
        (0, Frame(0x185, b"\1")), (10, Frame(0x185, b"\2")), (30, Frame(0x185, b"\3")),
        (40, Frame(0x185, b"\4", fd=FDF)), (50, Frame(0x18FEF100, is_extended=True)),
        (60, Frame(0x18FEF200, is_extended=True)), (61, Frame(0x705, is_remote=True)),
    ]  # fmt: skip
    state = state_of(*frames)
    assert set(state.streams) == {0x185, FIRST_FD + 0x185, EXTENDED, 0x705}
    assert [each.count for each in state.streams.values()] == [3, 1, 2, 1]
    names = ["TPDO1", "CAN FD", "29-bit", "heartbeat"]
    assert [each.name for each in state.streams.values()] == names
    assert [each.node_id for each in state.streams.values()] == [5, None, None, 5]
    assert [each.is_from_node for each in state.streams.values()] == [True, False, False, False]
    assert state.streams[0x185].period == 0.015
    assert state.streams[0x185].frame.data == b"\3"
    assert math.isnan(state.streams[0x705].period)
    assert (state.frames, state.now, state.silence) == (7, 61 * MS, 0.0)
    assert state.age_of(state.streams[0x185]) == pytest.approx(0.031)
    assert [state.has_heard(node_id) for node_id in (4, 5)] == [False, True]
    state.wait(1_000 * MS)
    assert (state.now, state.silence) == (1_061 * MS, 1.0)
    state.wait(2_000 * MS)
    assert (state.now, state.silence) == (2_061 * MS, 2.0)


def test_sixteen_times_count_for_a_period():
    times = [0, *range(1000, 1100, 10), *range(1110, 1260, 30)]
    state = state_of(*beats(*times))
    gaps = [after - before for before, after in pairwise(times)][-15:]
    assert state.heartbeat_of(5) == pytest.approx(median(gaps) * 1e-3)


@pytest.mark.parametrize(
    ("times", "wait", "period", "missing"),
    [
        ([0, 100, 200, 300], 500, math.nan, 0.0),  # three intervals are no period
        ([0, 100, 200, 300, 400], 250, 0.1, 0.0),
        ([0, 100, 200, 300, 400], 250.001, 0.1, 0.250001),
        ([], 500, math.nan, 0.0),
    ],
)
def test_a_heartbeat_is_missing_after_two_and_a_half_periods(times, wait, period, missing):
    state = state_of((0, Frame(0x185)), *beats(*times))
    state.wait(round(wait * MS))
    assert state.heartbeat_of(5) == pytest.approx(period, nan_ok=True)
    assert state.heartbeat_missing(5) == pytest.approx(missing)


def test_the_load_is_that_of_the_last_second():
    frames = [(10 * number, Frame(0x185, bytes(8))) for number in range(50)]
    state = state_of(*frames, bitrate=20_000)
    state.wait(510 * MS)
    assert state.load == pytest.approx(50 * bits_of(Frame(0x185, bytes(8))) / 20_000, rel=0.05)
    fast = [(now, frame._replace(fd=FDF | 2)) for now, frame in frames]
    loads = [state_of(*fast, speedup=each).load for each in (1.0, 4.0)]
    ratio = bits_of(fast[0][1], 4.0) / bits_of(fast[0][1], 1.0)
    assert loads[1] / loads[0] == pytest.approx(ratio)


def test_nodes_are_those_that_are_known_or_have_spoken():
    known = [KnownNode(9, "late", load_eds(PRESSURE_404, 9))]
    state = state_of(*beats(0), (1, Frame(0x601, bytes(8))), (2, Frame(0x205)), known=known)
    assert [node.node_id for node in state.nodes] == [5, 9]


def test_values_keep_their_lowest_and_highest():
    known = [KnownNode(2, "pressure", load_eds(PRESSURE_404, 2))]
    state = state_of(*beats(0, node_id=2), known=known)
    for now, raw in enumerate((300, 100, 200)):
        frame = Frame(0x182, raw.to_bytes(2, "little") + bytes(3))
        state.take(LoggedFrame(frame, now * MS, None))
    (held,) = [each for each in state.values[0x182].values() if each.low != each.high]
    lowest, last, highest = held.low, held.reading.value, held.high
    assert highest / lowest == pytest.approx(3.0)
    assert last / lowest == pytest.approx(2.0)


def test_errors_stay_until_a_reset_with_an_empty_register_or_a_boot_up():
    state = state_of((0, emcy(0x8130)), (1, emcy(0x5000)), (2, emcy(0x8130)))
    assert list(state.errors[5]) == [0x5000, 0x8130]
    state.take(LoggedFrame(emcy(0, register=1), 3 * MS, None))
    assert len(state.errors[5]) == 2
    state.take(LoggedFrame(emcy(0, register=0), 4 * MS, None))
    assert state.errors[5] == {}
    for number in range(9):
        state.take(LoggedFrame(emcy(0x6000 + number), 5 * MS, None))
    assert list(state.errors[5]) == list(range(0x6001, 0x6009))  # eight are kept
    state.take(LoggedFrame(Frame(0x705, b"\0"), 6 * MS, None))
    assert 5 not in state.errors


def test_six_events_are_kept_and_one_that_comes_again_is_the_latest():
    commands = [Frame(0, bytes([1, node_id])) for node_id in range(1, 8)]
    state = state_of(*((now, frame) for now, frame in enumerate(commands)))
    assert [each.frame for each in state.events] == commands[1:]
    state.take(LoggedFrame(commands[2], 10 * MS, None))
    assert [each.frame for each in state.events] == [commands[1], *commands[3:], commands[2]]


def recorded(distance, *, identifiers=3, count=7, second=None):
    """Heartbeats each 100 ms of some nodes, each a second time after a distance [ms]."""
    watch, frames = Recordings(), []
    for node_id in range(1, identifiers + 1):
        for number in range(count):
            now = 100 * number + node_id
            frames.append((now, Frame(0x700 + node_id, b"\5")))
            if second is None or node_id in second:
                frames.append((now + distance, Frame(0x700 + node_id, b"\5")))
    for now, frame in sorted(frames, key=lambda each: each[0]):
        watch.take(frame, round(now * MS))
    return [each.text for each in watch.findings()]


@pytest.mark.parametrize(
    ("options", "is_one"),
    [
        ({"distance": 7}, False),
        ({"distance": 20}, False),
        ({"distance": 7, "identifiers": 2}, True),
        ({"distance": 7, "count": 3}, True),  # five intervals of each are too few
        ({"distance": 7, "second": ()}, True),
        ({"distance": 7, "identifiers": 5, "second": (1, 2, 3, 4)}, False),  # four fifths
        ({"distance": 7, "identifiers": 4, "second": (1, 2, 3)}, True),
    ],
)
def test_two_recordings_show_by_three_identifiers_that_come_twice(options, is_one):
    found = recorded(**options)
    text = f"all frames come twice, {options['distance']} ms apart: two recordings of one bus"
    assert [each.startswith(text) for each in found] == ([] if is_one else [True])
