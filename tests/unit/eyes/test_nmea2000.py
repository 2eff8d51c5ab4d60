"""Boats: NMEA 2000 is J1939 with fast packets, and sends much at changes.

The layout of a fast packet and the parameter groups are as public tools have them; the cases are
those that `explain` took for faults on recordings of real boats.
"""

import pytest

from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.explain.explain import explain
from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import LoggedFrame

MS = 1_000_000
HEADING, POSITION, CLAIM, REQUEST = 0x09F11200, 0x0DF80500, 0x18EEFF00, 0x18EA0000


def extended(ms, can_id, data):
    return LoggedFrame(Frame(can_id, bytes(data), is_extended=True), round(ms * MS), None)


def fast(ms, source, size=43, number=0, gap=0.6):
    """A fast packet: six bytes in the first frame, seven in each of the next."""
    frames = 1 - -(size - 6) // 7
    heads = [[number << 5, size], *([number << 5 | each] for each in range(1, frames))]
    return [
        extended(ms + gap * each, POSITION | source, (head + [0x11] * 8)[:8])
        for each, head in enumerate(heads)
    ]


def explained(*frames):
    return explain(sorted(frames, key=lambda each: each.now), (), 250_000)


def beats(source, since, until, period=100):
    """A heading with its counter of messages, which looks like one of a fast packet."""
    times = range(since, until, period)
    return [extended(t, HEADING | source, [n % 253, 9, *[0] * 6]) for n, t in enumerate(times)]


def claim(ms, source):
    return extended(ms, CLAIM | source, [source, 0, 0, 0, 0, 0, 0, 0xC0])


def causes(*frames):
    return [each.cause for each in explained(*frames).findings]


@pytest.mark.parametrize(("size", "count"), [(13, 2), (14, 3), (43, 7), (223, 32)])
def test_the_frames_of_a_fast_packet_are_counted(size, count):
    """13 bytes are 6 and 7, 14 are one more, 223 are 6 and 31 times 7."""
    decoder = Decoder()
    sights = [sight for each in [claim(0, 3), *fast(1, 3, size)] for sight in decoder.take(each)]
    later = [sight.text for sight in sights[2:]]
    assert len(later) == count - 1
    assert later[0].startswith(f"frame 2 of {count} of a fast packet [01 11 ")
    assert later[-1].startswith(f"frame {count} of {count} of a fast packet [")
    assert [sight.message is None for sight in sights] == [False, False, *[True] * (count - 1)]


@pytest.mark.parametrize("gap", [0.6, 50, 50.1])
def test_what_follows_late_or_out_of_order_is_a_message_of_its_own(gap):
    decoder = Decoder()
    frames = [claim(0, 3), *fast(1, 3, 20, gap=gap)]
    sights = [sight for each in frames for sight in decoder.take(each)]
    assert (sights[2].message is None) == (gap <= 50)
    decoder = Decoder()
    one, two, three = fast(1, 3, 20)
    sights = [sight for each in [claim(0, 3), one, three, two] for sight in decoder.take(each)]
    assert [sight.message is None for sight in sights[1:]] == [False, False, False]


def test_a_counter_of_messages_is_no_fast_packet():
    decoder = Decoder()
    sights = [s for each in [claim(0, 5), *beats(5, 1, 9000)] for s in decoder.take(each)]
    assert all(sight.message is not None for sight in sights)


def test_bursts_have_no_period_of_their_own():
    frames = [claim(0, 3), *beats(3, 1, 9000)]
    for number in range(9):
        frames += fast(50 + 1000 * number, 3, number=number % 8)
    assert causes(*frames) == []
    gone = [
        each
        for each in frames
        if not 3000 < each.now / MS < 8000 or each.frame.can_id != POSITION | 3
    ]
    assert causes(*gone) == []  # of nine, five are gone: too few have come for a period


def test_ten_frames_of_its_groups_show_the_language():
    assert explained(*beats(3, 0, 1000)).languages == ("J1939",)
    assert explained(*beats(3, 0, 900)).languages == ()


def test_small_identifiers_of_29_bits_show_nothing():
    """As an engine controller of cars has it: 0x180 would be group 0 of J1939."""
    frames = [extended(10 * n, 0x180, bytes(8)) for n in range(50)]
    assert explained(*frames).languages == ()


@pytest.mark.parametrize(
    ("devices", "is_silent", "expected"),
    [(2, False, [Cause.J1939_RESTART] * 2), (3, False, []), (3, True, [Cause.J1939_RESTART] * 3)],
)
def test_many_that_claim_at_once_were_asked_where_the_bus_goes_on(devices, is_silent, expected):
    """An adapter does not record the request that it sends. Where all was dark, it is none."""
    sources = range(1, devices + 1)
    frames = [claim(source, source) for source in sources]
    for source in sources:
        frames += beats(source, 100 + source, 5000, 1000)
        frames += beats(source, 7600 + source, 12000, 1000)
        frames.append(claim(7000 + 120 * source, source))
    if not is_silent:
        frames += [claim(0, 9), *beats(9, 10, 12000)]
    assert [each for each in causes(*frames) if each is not Cause.BUS_SILENT] == expected


def test_claims_again_and_again_of_many_are_answers():
    frames = [claim(0, 9), *beats(9, 10, 40_000)]
    for source in (1, 2, 3):
        frames += [claim(ms + 100 * source, source) for ms in range(0, 40_000, 8000)]
    assert causes(*frames) == []
    assert causes(
        *[each for each in frames if each.frame.can_id not in {CLAIM | 2, CLAIM | 3}]
    ) == [Cause.J1939_RESTART]


def test_who_asks_at_addresses_of_nobody_looks_for_a_free_one():
    ask = [extended(5000 + 50 * n, REQUEST | n << 8 | 9, [0, 0xEE, 0]) for n in range(20, 30)]
    frames = [claim(0, 9), *beats(9, 10, 9000)]
    assert causes(*frames, *ask) == []
    heard = [claim(1, 25), *beats(25, 10, 9000)]
    assert causes(*frames, *heard, *ask) == [Cause.J1939_REQUEST]


@pytest.mark.parametrize(("gaps", "expected"), [(12, [Cause.J1939_MISSING]), (13, [])])
def test_what_stays_out_again_and_again_has_no_period(gaps, expected):
    """Eight messages of 25 ms, then none for 0.5 s: a dozen behind the first are its way."""
    times = [700 * burst + 25 * each for burst in range(gaps + 1) for each in range(8)]
    frames = [extended(t, HEADING | 4, [n % 253, 200, *[0] * 6]) for n, t in enumerate(times)]
    assert causes(claim(0, 4), *frames, *beats(9, 0, 700 * gaps + 200, 50)) == expected
