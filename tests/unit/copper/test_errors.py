"""Errors on a bus of copper, by the numbers of ISO 11898-1; a bit is 1 us at 1 Mbit/s."""

import pytest

from hil_bench.abilities.copper.wire.arbitration import dominant_errors
from hil_bench.abilities.copper.wire.attempt import ErrorKind, disturbed, unacknowledged
from hil_bench.abilities.copper.wire.bits import exact_bits, stuffed_bits
from hil_bench.abilities.copper.wire.station import CanState, Station
from hil_bench.abilities.copper.wire.wire import Wire
from hil_bench.canopen_device.emcy import CanEvent
from hil_bench.canopen_device.frame import Frame

US = 1000
LONG = 10**12


class Rig:
    """Stations a, b and c at 1 Mbit/s, and what has been told of them."""

    def __init__(self, names="abc", **options):
        self.stations = [Station(name, 100) for name in names]
        self.wire = Wire(1_000_000, self.stations, **options)
        self.told, self.errors = [], []
        self.wire.on_event = lambda station, event: self.told.append((station.name, event))
        self.wire.on_error = self.errors.append


def always(_frame):
    return 0.5


def test_a_sender_that_always_fails_is_passive_after_16_and_off_after_32_errors():
    rig = Rig()
    a, b, _ = rig.stations
    a.send_rules.append(always)
    rig.wire.put(a, Frame(0x100), 0)
    rig.wire.advance(0)
    for _ in range(64):  # begin and end of each
        assert rig.wire.step() is None
    assert rig.told == [("a", CanEvent.PASSIVE), ("a", CanEvent.BUS_OFF)]
    assert len(rig.errors) == 32
    assert b.rec == 32  # 1 each for a receiver that notices by the flag of another
    assert b.state is CanState.ACTIVE


def test_bus_off_ends_after_128_times_11_recessive_bits_and_the_frame_is_still_there():
    rig = Rig()
    a = rig.stations[0]
    rig.wire.force_off(a, 0)
    rig.wire.put(a, Frame(0x100), 0)
    rig.wire.let_recover(a, 5 * US)
    (passed,) = rig.wire.run(LONG)
    assert passed.begin == (5 + 1408) * US
    assert rig.told == [("a", CanEvent.BUS_OFF), ("a", CanEvent.RECOVERED)]
    assert (a.tec, a.rec) == (0, 0)


def test_frames_of_others_hold_a_recovery_up_since_each_ends_with_one_sequence():
    rig = Rig()
    a, b, _ = rig.stations
    rig.wire.force_off(a, 0)
    rig.wire.let_recover(a, 0)
    rig.wire.put(a, Frame(0x001), 0)
    frame = Frame(0x100, bytes(8))
    for _ in range(60):
        rig.wire.put(b, frame, 0)
    passed = rig.wire.run(LONG)
    assert [each.station.name for each in passed] == ["b"] * 60 + ["a"]
    # 60 of the 128 sequences at the ends of frames, the rest on the idle bus.
    assert passed[-1].begin == (60 * exact_bits(frame) + 68 * 11) * US
    assert all(a in each.deaf for each in passed[:60])


@pytest.mark.parametrize(("before", "after"), [(0, 0), (1, 0), (127, 126), (128, 127), (135, 127)])
def test_a_frame_that_passes_makes_a_receiver_active_again(before, after):
    """ISO 11898-1: one less up to 127; above it, a value of 119 to 127, of which 127 is ours."""
    station = Station("a", 8)
    station.rec = before
    assert station.state is (CanState.PASSIVE if before >= 128 else CanState.ACTIVE)
    station.receive()
    assert (station.rec, station.state) == (after, CanState.ACTIVE)


def test_nobody_there_makes_a_station_passive_and_never_off():
    rig = Rig("a")
    (a,) = rig.stations
    rig.wire.put(a, Frame(0x100), 0)
    assert rig.wire.run(LONG // 1000) == []
    assert (a.tec, a.state) == (128, CanState.PASSIVE)
    assert {each.broken.kind for each in rig.errors} == {ErrorKind.ACK}
    other = Station("b", 1)
    rig.wire.join(other, LONG)
    (passed,) = rig.wire.run(2 * LONG)
    assert (passed.begin, a.tec) == (LONG, 127)


def test_a_frame_without_acknowledge_ends_behind_the_slot():
    bits = stuffed_bits(Frame(0x100))
    # CRC delimiter and slot, flag of 6, delimiter of 8, intermission of 3
    assert unacknowledged(bits).length == len(bits) + 2 + 6 + 8 + 3


# Frame 0x000 without data begins 00000 1 00000 1: start bit and identifier, with stuff bits.
@pytest.mark.parametrize(
    ("position", "flags"),
    [
        (4, 12),  # recessive: no dominant bit before the flag, whose sixth bit the others need
        (5, 6),  # the stuff bit is dominant: six in a row, and all notice at once
        (6, 12),
        (2, 12),
    ],
)
def test_flags_of_sender_and_others_overlap(position, flags):
    bits = stuffed_bits(Frame(0x000))
    assert bits[:7] == [0, 0, 0, 0, 0, 1, 0]
    end = disturbed(bits, position, is_passive=False, has_active_others=True)
    assert end.length == position + 1 + flags + 8 + 3


def test_two_stations_with_one_identifier_break_each_other_until_they_are_passive():
    rig = Rig()
    a, b, _ = rig.stations
    rig.wire.put(a, Frame(0x181, b"\x00"), 0)
    rig.wire.put(b, Frame(0x181, b"\xff"), 0)
    passed = rig.wire.run(LONG)
    assert [each.frame.data for each in passed] == [b"\x00", b"\xff"]
    assert len(rig.errors) == 16
    # 16 times 8; the one falls out once more, and both count down with what passes
    assert (a.tec, b.tec) == (127, 135)


def test_the_same_frame_of_two_stations_is_one_on_the_bus():
    rig = Rig()
    a, b, _ = rig.stations
    for station in (a, b):
        rig.wire.put(station, Frame(0x181, b"\x00"), 0)
    assert len(rig.wire.run(LONG)) == 1
    assert (a.waiting, b.waiting, rig.errors) == (0, 0, [])


def test_a_dominant_bus_makes_receivers_passive_and_the_sender_bus_off():
    rig = Rig()
    a, b, _ = rig.stations
    rig.wire.put(a, Frame(0x100, bytes(8)), 0)
    rig.wire.run(20 * US)
    rig.wire.stick(20 * US)
    rig.wire.run((20 + 100) * US)
    # noticed at bit 6: 1; behind the flag: 8; 14 bits from its begin and each 8 after it: 8
    assert b.rec == 1 + 8 + 8 * (1 + (100 - 6 - 14) // 8)
    rig.wire.run((20 + 254) * US)
    assert (a.state, a.tec) == (CanState.PASSIVE, 8 + 8 * 30)
    rig.wire.run((20 + 255) * US)
    assert (a.state, b.state) == (CanState.BUS_OFF, CanState.PASSIVE)
    rig.wire.unstick(1000 * US)
    rig.wire.put(b, Frame(0x300), 1000 * US)
    passed = rig.wire.run(LONG)
    assert passed[0].begin == (1000 + 11) * US
    assert [each.frame.can_id for each in passed] == [0x300, 0x100]


def test_a_dominant_bus_counts_from_its_first_bit_at_0_on():
    rig = Rig()
    rig.wire.stick(0)
    rig.wire.run(100 * US)
    assert rig.stations[1].rec == 1 + 8 + 8 * (1 + (100 - 6 - 14) // 8)


def test_dominant_bits_count_as_the_standard_says():
    expected = {
        (True, 0): 0,
        (True, 1): 8,
        (True, 14): 8,
        (True, 15): 16,
        (True, 22): 16,
        (True, 23): 24,
        (False, 5): 0,
        (False, 6): 1,
        (False, 12): 1,
        (False, 13): 9,
        (False, 19): 9,
        (False, 20): 17,
        (False, 28): 25,
    }
    assert {
        (is_sender, bits): dominant_errors(bits, is_sender=is_sender)
        for is_sender, bits in expected
    } == expected


def test_who_leaves_in_the_middle_of_its_frame_keeps_it():
    rig = Rig()
    a, b, c = rig.stations
    rig.wire.put(a, Frame(0x100), 0)
    rig.wire.run(20 * US)
    rig.wire.leave(a, 20 * US)
    rig.wire.put(b, Frame(0x200), 21 * US)
    (passed,) = rig.wire.run(LONG)
    # Both error flags one after the other, delimiter and intermission: 6 + 6 + 8 + 3 bits.
    assert passed.begin == rig.errors[0].end == (20 + 23) * US
    assert (a.waiting, c.rec) == (1, 0)  # 1 for the error, and one less for the frame
    rig.wire.join(a, LONG)
    assert len(rig.wire.run(2 * LONG)) == 1
