"""Frames of CAN FD on the wire, beside what hardware of others has measured."""

import itertools
import random

import pytest

from hil_bench.abilities.copper.wire.attempt import AFTER_FLAGS, FLAG, ErrorKind
from hil_bench.abilities.copper.wire.bits import exact_bits, exact_fd_bits, fast_place, stuffed_bits
from hil_bench.abilities.copper.wire.station import CanState, Station
from hil_bench.abilities.copper.wire.wire import Wire
from hil_bench.abilities.eyes.traffic import worst_fd_bits
from hil_bench.canopen_device.frame import BRS, ESI, FDF, Frame
from hil_bench.frame import FD_LENGTHS, bits_of, frame_bits, priority

LONG = 10**12
DRAW = random.Random(11898)  # noqa: S311 - frames, not secrets

MEASURED = [
    (0x07D, "011bd6d08a1fd7f6", 104_812, 132, 0x0F6C9),
    (0x088, "0000f69000000000", 105_812, 137, 0x1B0B3),
    (0x167, "738000100009e300", 102_187, 133, 0x0FB6C),
]
"""Identifier, data, duration [ns], bits and CRC of three frames with BRS at 500 kbit/s and
2 Mbit/s, as an interface of Vector has logged them (`test/data/logfile_vector_fd.asc` of
python-can; two of its lines were edited: BRS and ESI of the second are changed, and the third is
extended)."""


def measured(can_id, data):
    return Frame(can_id, bytes.fromhex(data), fd=FDF | BRS)


@pytest.mark.parametrize(("can_id", "data", "_duration", "bits", "crc"), MEASURED)
def test_a_frame_has_the_bits_and_the_crc_that_hardware_has_logged(
    can_id, data, _duration, bits, crc
):
    frame = measured(can_id, data)
    assert exact_bits(frame) == bits
    # Of the 21 bits behind the data, a fixed stuff bit is before each four; the CRC is the rest.
    field = stuffed_bits(frame)[-27:]
    plain = [bit for place, bit in enumerate(field) if place % 5]
    assert int("".join(map(str, plain[4:])), 2) == crc
    assert all(field[place] != field[place - 1] for place in range(5, 27, 5))


def test_the_bits_behind_brs_are_four_times_as_fast_as_in_the_log():
    """Durations count from one edge to another, so their differences are compared; 125 ns is one
    step of the log's clock."""
    times = []
    for can_id, data, duration, *_ in MEASURED:
        slow, fast = exact_fd_bits(measured(can_id, data))
        times.append((slow * 2000 + fast * 500, duration))
    for (own, logged), (next_own, next_logged) in itertools.pairwise(times):
        assert next_own - own == pytest.approx(next_logged - logged, abs=126)


@pytest.mark.parametrize("is_extended", [False, True])
@pytest.mark.parametrize("length", FD_LENGTHS)
def test_the_fields_are_those_of_the_kernel(length, is_extended):
    """linux/can/length.h: 67 and 86 bits with CRC21, without stuff bits; CRC17 has five fewer."""
    fields = (86 if is_extended else 67) - (5 if length <= 16 else 0) + 8 * length
    slow, fast = worst_fd_bits(length, is_extended=is_extended)
    usual = bits_of(Frame(1, bytes(length), is_extended=is_extended, fd=FDF))
    assert fields < usual < slow + fast
    for _ in range(20):
        data = DRAW.choice([bytes(length), DRAW.randbytes(length)])
        can_id = DRAW.getrandbits(29 if is_extended else 11)
        frame = Frame(can_id, data, is_extended=is_extended, fd=FDF | BRS)
        bits = exact_fd_bits(frame)
        assert fields <= sum(bits)
        assert bits[0] <= slow
        assert bits[1] <= fast
        # CRC delimiter, acknowledgement and its delimiter, end of frame, intermission.
        assert sum(bits) == len(stuffed_bits(frame)) + 1 + 2 + 7 + 3


def test_the_most_stuff_bits_are_those_of_the_literature():
    """673 bits behind BRS with 64 bytes (electronics.stackexchange.com 284797), before ISO 11898-1
    added the stuff count of 4 bits with a fixed stuff bit. That is of an error-active sender; ESI
    recessive may be the second of five equal bits, and brings one more."""
    _, fast = worst_fd_bits(64)
    assert fast == 673 + 5 + 1


def test_the_mean_length_counts_the_data_at_their_own_rate():
    classical, fd = Frame(1, bytes(8)), Frame(1, bytes(8), fd=FDF | BRS)
    assert bits_of(classical, 8.0) == frame_bits(8)
    # 29 bits from the start to BRS and from the acknowledgement on, and half of 3.25 stuff bits.
    slow = 29 + 3.25 / 2
    fast = 5 + 64 + 28 + 17 / 2
    assert bits_of(fd, 8.0) == pytest.approx(slow + fast / 8)
    assert bits_of(fd._replace(fd=FDF), 8.0) == pytest.approx(slow + fast)


def test_a_frame_takes_its_time_at_both_bit_rates():
    a, b = Station("a", 8), Station("b", 8)
    wire = Wire(500_000, [a, b], data_bitrate=2_000_000)
    frame = measured(*MEASURED[0][:2])
    wire.put(a, frame, 0)
    wire.put(a, frame._replace(fd=FDF), 0)
    switched, plain = wire.run(LONG)
    slow, fast = exact_fd_bits(frame)
    assert slow + fast == 132
    assert switched.end == slow * 2000 + fast * 500
    assert plain.end - plain.begin == exact_bits(frame._replace(fd=FDF)) * 2000


@pytest.mark.parametrize("is_extended", [False, True])
def test_a_classical_frame_wins_against_one_of_can_fd_and_that_against_a_remote_one(is_extended):
    """FDF is dominant in a classical frame, and RRS where a remote frame has RTR."""
    classical = Frame(0x100, b"\xff", is_extended=is_extended)
    fd = Frame(0x100, bytes(64), is_extended=is_extended, fd=FDF)
    remote = Frame(0x100, is_remote=True, is_extended=is_extended)
    following = Frame(0x101, is_extended=is_extended)
    ordered = [classical, fd, remote, following]
    assert sorted([following, remote, fd, classical], key=priority) == ordered


@pytest.mark.parametrize("fd", [FDF | BRS, FDF])
@pytest.mark.parametrize("share", [0.02, 0.5, 0.98])
def test_an_error_ends_a_frame_at_the_bit_rate(share, fd):
    """Flags, delimiter and intermission have the bit rate, wherever the error was."""
    a, b, c = (Station(name, 8) for name in "abc")
    wire, errors = Wire(500_000, [a, b, c], data_bitrate=2_000_000), []
    wire.on_error = errors.append
    frame = Frame(0x123, DRAW.randbytes(64), fd=fd)
    shares = [share]
    a.send_rules.append(lambda _frame: shares.pop() if shares else None)
    wire.put(a, frame, 0)
    (passed,) = wire.run(LONG)
    (error,) = errors
    bits = error.broken.position + 1
    fast = min(max(bits - fast_place(frame), 0), exact_fd_bits(frame)[1]) if fd & BRS else 0
    after = error.broken.length - bits
    assert FLAG + AFTER_FLAGS <= after <= 2 * FLAG + AFTER_FLAGS
    assert error.end == (bits - fast + after) * 2000 + fast * 500
    assert passed.begin == error.end
    assert error.broken.kind is ErrorKind.BIT


def test_an_error_passive_sender_says_so_by_esi():
    a, b = Station("a", 8), Station("b", 8)
    wire = Wire(500_000, [a, b], data_bitrate=2_000_000)
    a.tec = 128
    assert a.state is CanState.PASSIVE
    wire.put(a, Frame(0x123, bytes(12), fd=FDF | BRS), 0)
    wire.put(a, Frame(0x124), 0)
    assert [each.frame.fd for each in wire.run(LONG)] == [FDF | BRS | ESI, 0]
