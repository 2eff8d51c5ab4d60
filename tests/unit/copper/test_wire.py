"""A bus of copper: who sends when, and how long it takes; a bit is 1 us at 1 Mbit/s."""

import itertools

import pytest

from hil_bench.abilities.copper.wire.bits import exact_bits
from hil_bench.abilities.copper.wire.station import Order, Station
from hil_bench.abilities.copper.wire.wire import Wire
from hil_bench.canopen_device.emcy import CanEvent
from hil_bench.canopen_device.frame import Frame
from hil_bench.frame import priority

US = 1000
LONG = 10**12


def rig(*orders, depth=8, bitrate=1_000_000):
    stations = [
        Station(name, depth, order) for name, order in zip("abcd", orders or "pp", strict=False)
    ]
    for station in stations:
        station.order = Order.FIFO if station.order == "f" else Order.PRIORITY
    return Wire(bitrate, stations), *stations


def test_the_lowest_identifier_goes_first_and_nothing_is_interrupted():
    wire, a, b = rig()
    late, early, urgent = Frame(0x300), Frame(0x200), Frame(0x100)
    wire.put(a, late, 0)
    wire.put(b, early, 0)
    assert wire.run(10 * US) == []  # on the bus, but not over
    wire.put(a, urgent, 10 * US)
    passed = wire.run(LONG)
    assert [each.frame for each in passed] == [early, urgent, late]
    assert [each.station for each in passed] == [b, a, a]
    bits = [exact_bits(frame) for frame in (early, urgent, late)]
    ends = [US * sum(bits[: number + 1]) for number in range(3)]
    assert [each.end for each in passed] == ends
    assert [each.begin for each in passed] == [0, *ends[:2]]
    assert [each.released for each in passed] == [0, 10 * US, 0]
    assert wire.busy == ends[-1]


def test_an_idle_bus_sends_at_once():
    wire, a, _ = rig(bitrate=125_000)
    assert wire.run(5_000_000) == []
    wire.put(a, Frame(0x80), 5_000_000)
    (sent,) = wire.run(LONG)
    assert (sent.begin, sent.end) == (5_000_000, 5_000_000 + 8 * US * exact_bits(Frame(0x80)))


def test_what_is_put_at_the_time_of_a_begin_takes_part():
    wire, a, b = rig()
    wire.put(a, Frame(0x200), 7 * US)
    wire.run(7 * US)
    wire.put(b, Frame(0x100), 7 * US)
    assert [each.frame.can_id for each in wire.run(LONG)] == [0x100, 0x200]


@pytest.mark.parametrize(
    ("order", "expected"), [("f", [0x200, 0x300, 0x100]), ("p", [0x100, 0x200, 0x300])]
)
def test_a_fifo_holds_an_urgent_frame_back_and_a_sorted_buffer_does_not(order, expected):
    """The inversion of priorities that buffers in the order of arrival bring."""
    wire, a, b = rig(order, "p")
    wire.put(a, Frame(0x300), 0)
    wire.put(a, Frame(0x100), 0)
    wire.put(b, Frame(0x200), 0)
    assert [each.frame.can_id for each in wire.run(LONG)] == expected


def test_a_frame_beyond_the_depth_is_counted_and_told_once():
    wire, a, _ = rig(depth=2)
    told = []
    wire.on_event = lambda station, event: told.append((station, event))
    taken = [wire.put(a, Frame(0x100 + number), 0) for number in range(4)]
    assert taken == [True, True, False, False]
    assert a.refused == 2
    assert told == [(a, CanEvent.OVERRUN)]
    assert [each.frame.can_id for each in wire.run(LONG)] == [0x100, 0x101]
    assert told == [(a, CanEvent.OVERRUN), (a, CanEvent.SENT_ALL)]


def test_a_sorted_buffer_that_is_full_drops_what_would_be_sent_last():
    wire, a, _ = rig(depth=2)
    taken = [wire.put(a, Frame(can_id), 0) for can_id in (0x300, 0x200, 0x100)]
    assert (taken, a.refused) == ([True, True, False], 1)
    assert [each.frame.can_id for each in wire.run(LONG)] == [0x100, 0x200]


def test_the_frame_on_the_bus_takes_its_place_in_the_buffer():
    wire, a, _ = rig(depth=1)
    wire.put(a, Frame(0x100), 0)
    wire.run(US)
    assert not wire.put(a, Frame(0x101), US)


def test_no_frame_is_lost_or_doubled_where_buffers_are_mixed():
    """Frames of higher and lower priority in turn, on a bus that never gets idle."""
    wire, a, b = rig("p", "f", depth=1000)
    got = []
    for number in range(300):
        now = number * 20 * US
        got += wire.run(now)
        wire.put(a, Frame(0x400 - number, bytes([number % 256])), now)
        wire.put(b, Frame(0x080 + number, bytes([number % 256])), now)
    got += wire.run(LONG)
    assert len(got) == len({each.frame for each in got}) == 600
    assert all(late.begin == early.end for early, late in itertools.pairwise(got))
    of_b = [each.frame.can_id for each in got if each.station is b]
    assert of_b == sorted(of_b)


# ISO 11898-1: RTR is recessive in a remote frame, SRR and IDE in one of 29 bits.
def test_arbitration_goes_by_the_bits_on_the_bus():
    order = [
        Frame(0x100),
        Frame(0x100, is_remote=True),
        Frame(0x100 << 18, is_extended=True),
        Frame(0x100 << 18, is_extended=True, is_remote=True),
        Frame(0x100 << 18 | 1, is_extended=True),
        Frame(0x101),
    ]
    assert sorted([order[3], order[5], *order[:3], order[4]], key=priority) == order


@pytest.mark.parametrize("bitrate", [10_000, 83_333, 800_000])
def test_a_bus_that_is_never_idle_is_exact_after_a_thousand_frames(bitrate):
    wire, a, _ = rig(bitrate=bitrate)
    frame, now = Frame(0x181, b"\x55" * 8), 0
    wire.put(a, frame, 0)
    for _ in range(1000):
        now = wire.advance(LONG).end
        wire.put(a, frame, now)
    exact = 1000 * exact_bits(frame) * 1e9 / bitrate
    assert abs(now - exact) <= 1000  # a nanosecond a frame
