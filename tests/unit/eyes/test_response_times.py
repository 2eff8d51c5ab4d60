"""Response times beside the published example, and beside a simulation of the same bus."""

import random

import pytest

from device_profiles import PRESSURE_404
from hil_bench.abilities.copper.wire.station import Station
from hil_bench.abilities.copper.wire.wire import Wire
from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.abilities.eyes.traffic import (
    Assumptions,
    Message,
    find_streams,
    response_times,
    utilisation,
    worst_bits,
)
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.frame import Frame

US = 1000
MS = 1_000_000


def test_the_example_of_the_paper():
    # Davis et al. 2007, table 1: 125 kbit/s, 7 data bytes, 125 bits are 1 ms; section 3.1: the
    # older analysis has 3 ms for C, and its second instance takes 3.5 ms.
    transmission = worst_bits(7) * 8 * US
    assert transmission == MS
    periods = {"A": 2_500_000, "B": 3_500_000, "C": 3_500_000}
    messages = [
        Message(name, place, period, transmission)
        for place, (name, period) in enumerate(periods.items())
    ]
    assert response_times(messages, bit_time=8 * US) == {"A": 2 * MS, "B": 3 * MS, "C": 3_500_000}


def test_a_message_alone_waits_for_what_is_on_the_bus_already():
    only = Message("only", 1, 10 * MS, 100 * US)
    assert response_times([only], bit_time=US, blocking=135 * US) == {"only": 235 * US}


def test_jitter_counts_for_itself_and_for_those_below():
    first = Message("first", 1, 5 * MS, MS, jitter=2 * MS)
    second = Message("second", 2, 20 * MS, 4 * MS)
    times = response_times([second, first], bit_time=US)
    # 2 ms late, behind 4 ms of the second; the second behind the first, which may come again after
    # 3 ms, but not before the second is on the bus: 1 ms + 4 ms.
    assert times == {"first": 7 * MS, "second": 5 * MS}


def test_jitter_of_a_higher_message_lets_it_come_twice():
    # 1 ms of the first and 3 ms of the second: the first, 2 ms late before, is there again at 5 ms
    # less 2 ms. So the third waits 5 ms; without the jitter it would wait 4 ms.
    messages = [
        Message("first", 1, 5 * MS, MS, jitter=2 * MS),
        Message("second", 2, 20 * MS, 3 * MS),
        Message("third", 3, 20 * MS, MS),
    ]
    assert response_times(messages, bit_time=US)["third"] == 6 * MS


def test_what_does_not_fit_has_no_bound():
    first, second = Message("first", 1, 2 * MS, MS), Message("second", 2, 2 * MS, MS)
    assert utilisation([first, second]) == 1.0
    assert response_times([first, second], bit_time=US) == {"first": 2 * MS, "second": None}


@pytest.mark.parametrize("seed", range(10))
def test_no_simulation_is_slower_than_the_bound(seed):
    """Data are all zero, so frames have nearly the most stuff bits; phases are at random."""
    dice = random.Random(seed)  # noqa: S311 - no secrets
    streams = [
        (0x100 + number, dice.randrange(9), dice.choice([2, 3, 5, 7, 10]) * MS)
        for number in range(12)
    ]
    messages = [
        Message(str(can_id), can_id, period, worst_bits(length) * 4 * US)
        for can_id, length, period in streams
    ]
    bounds = response_times(messages, bit_time=4 * US)
    releases = sorted(
        (phase + period * number, can_id, length)
        for can_id, length, period in streams
        for phase in [dice.randrange(period) if seed else 0]
        for number in range(2_000 * MS // period)
    )
    sender, hearer = Station("sender", 10_000), Station("hearer", 1)
    wire, worst, sent = Wire(250_000, [sender, hearer]), dict.fromkeys(bounds, 0), []
    for now, can_id, length in releases:
        sent += wire.run(now)
        wire.put(sender, Frame(can_id, bytes(length)), now)
    for each in [*sent, *wire.run(3_000 * MS)]:
        name = str(each.frame.can_id)
        worst[name] = max(worst[name], each.end - each.released)
    bounded = {name: bound for name, bound in bounds.items() if bound is not None}
    assert bounded
    for name, bound in bounded.items():
        assert 0 < worst[name] <= bound


def test_a_pdo_without_inhibit_time_and_event_timer_has_the_period_that_is_assumed(make_file):
    text = PRESSURE_404.read_text()
    for section in ("1800sub3", "1800sub5"):
        before, _, rest = text.partition(f"[{section}]")
        text = before + rest.partition("\n\n")[2]
    path = make_file("device.eds", text)
    objects = load_eds(path, 2)
    objects.variable(0x1800, 2).value = 255
    streams = find_streams([KnownNode(2, "pressure", objects)], Assumptions(1_000_000, 7 * MS))
    (pdo,) = [stream for stream in streams if stream.frame.can_id == 0x182]
    assert (pdo.message.period, pdo.why) == (7 * MS, "assumed")


@pytest.mark.parametrize(
    ("transmission_type", "inhibit_100us", "event_ms", "period", "why"),
    [
        (255, 50, 10, 5 * MS, "inhibit time"),
        (255, 0, 10, 10 * MS, "event timer"),
        (255, 0, 0, 7 * MS, "assumed"),
        (3, 50, 10, 21 * MS, "SYNC"),
    ],
)
def test_the_shortest_period_of_a_pdo_is_that_of_its_objects(
    transmission_type, inhibit_100us, event_ms, period, why
):
    """0x1800.02, .03 in units of 100 us, .05 in ms (CiA 301); SYNC comes every 7 ms."""
    objects = load_eds(PRESSURE_404, 2)
    for subindex, value in ((2, transmission_type), (3, inhibit_100us), (5, event_ms)):
        objects.variable(0x1800, subindex).value = value
    streams = find_streams([KnownNode(2, "pressure", objects)], Assumptions(1_000_000, 7 * MS))
    (pdo,) = [stream for stream in streams if stream.frame.can_id == 0x182]
    assert (pdo.message.period, pdo.why) == (period, why)
