"""What one client may send on a hub, in virtual time: as much as the bus's bit rate carries.

A frame of 8 bytes and 11-bit identifier has 47 + 64 bits and (34 + 64 - 1) / 4 / 2 stuff bits, half
of the most that it can have (ISO 11898-1): 123.125 us at 1 Mbit/s.
"""

import pytest
from support import virtual_loop
from support.virtual_loop import Pace, VirtualLoop

from hil_bench.abilities.common.socketcand_protocol import BURST, RateLimit
from hil_bench.abilities.hub.server import Hub, HubLimits

MBIT = 1e6
TIME_OF_FRAME = 123.125e-6  # [s]
AT_ONCE = 10e-3 / TIME_OF_FRAME  # frames of the burst: 81.2
FRAME = b"< send 123 8 1 2 3 4 5 6 7 8 >"
PORT = 29536


def test_an_account_carries_what_the_bus_does():
    limit = RateLimit(MBIT)
    now = 5_000_000_000
    sent = []
    for _ in range(200):
        now += round(limit.delay(now))
        limit.take(123.125, now)
        sent.append((now - 5_000_000_000) * 1e-9)
    # The n-th frame when those before it have been on the bus, less the 10 ms of a burst.
    assert sent == pytest.approx([max(0.0, n * TIME_OF_FRAME - 10e-3) for n in range(200)])


def test_an_account_of_one_who_was_quiet_holds_no_more_than_a_burst():
    limit = RateLimit(MBIT)
    now = 3_600_000_000_000
    count = 0
    while not limit.delay(now):
        limit.take(123.125, now)
        count += 1
    assert count == 82  # with which the 10 ms are over
    assert limit.delay(now) == pytest.approx(82 * 123_125 - BURST)


class World:
    """A hub and its clients in virtual time."""

    def __init__(self, limits):
        self.loop = VirtualLoop(1)
        self.hub = Hub(("can0",), limits, lambda: round(self.loop.time() * 1e9))

    def run(self, scenario):
        async def whole():
            await self.hub.start(PORT)
            await scenario(self)

        try:
            self.loop.run_until_complete(whole())
            assert self.loop.errors == []
        finally:
            self.loop.close()

    async def join(self, *words):
        reader, writer = await self.loop.connect(PORT)
        for word in (b"< hi >", *words, b"< open can0 >", b"< rawmode >"):
            if word != b"< hi >":
                writer.write(word)
            answer = await reader.readuntil(b">")
            assert answer == (b"< hi >" if word == b"< hi >" else b"< ok >")
        writer.write(b"< send 7ff 0 >")  # it has read the answer
        return reader, writer

    async def hear(self, reader, can_id, count):
        """Return the times at which frames with an identifier arrived [s]."""
        times = []
        while len(times) < count:
            if b" %03X " % can_id in await reader.readuntil(b">"):
                times.append(self.loop.time())
        return times


@pytest.fixture(autouse=True)
def _quick_network(monkeypatch):
    monkeypatch.setattr(virtual_loop, "PACES", (Pace(65_536, 0.0),))


def test_a_client_sends_what_the_bit_rate_carries_and_then_waits(caplog):
    async def scenario(world):
        listener, _ = await world.join()
        _, flood = await world.join()
        begin = world.loop.time()
        flood.write(FRAME * 2000)
        times = [time - begin for time in await world.hear(listener, 0x123, 2000)]
        # One frame more has been sent before: an empty one, of 51.125 bits.
        earliest = [n * TIME_OF_FRAME - 10e-3 for n in range(2000)]
        assert all(time >= least for time, least in zip(times, earliest, strict=True))
        assert times[80] < 1e-3  # at once
        assert times[-1] < 2000 * TIME_OF_FRAME  # and no later than it has to be

    world = World(HubLimits(MBIT))
    world.run(scenario)
    assert caplog.messages == [
        "hub: the program at 10.0.0.1:2 sends more than a bus of 1 Mbit/s carries, and has to wait"
    ]


def test_what_is_beyond_it_waits_at_the_client_and_not_in_the_hub():
    async def scenario(world):
        listener, _ = await world.join()
        _, flood = await world.join()
        flood.write(FRAME * 2000)
        await world.hear(listener, 0x123, 82)
        # The network holds 4 KiB, and so does the hub at most what it had read before it waits.
        assert flood.transport.get_write_buffer_size() > len(FRAME) * 2000 - 3 * virtual_loop.WINDOW

    World(HubLimits(MBIT)).run(scenario)


def test_a_flood_holds_no_other_client_up():
    async def scenario(world):
        listener, _ = await world.join()
        _, flood = await world.join()
        _, other = await world.join()
        flood.write(FRAME * 5000)
        await world.hear(listener, 0x123, 1000)
        asked = world.loop.time()
        other.write(b"< send 456 0 >")
        (answered,) = await world.hear(listener, 0x456, 1)
        assert answered - asked < 1e-3

    World(HubLimits(MBIT)).run(scenario)


def test_commands_that_are_no_frames_count_too():
    async def scenario(world):
        reader, flood = await world.join()
        begin = world.loop.time()
        flood.write((b"<>" * 9 + FRAME) * 100)
        for _ in range(900):
            await reader.readuntil(b">")
        assert world.loop.time() - begin >= 998 * TIME_OF_FRAME - 10e-3

    World(HubLimits(MBIT)).run(scenario)


@pytest.mark.parametrize(
    ("limits", "words"), [(HubLimits(), ()), (HubLimits(MBIT, "secret"), (b"< owner secret >",))]
)
def test_without_a_limit_and_for_the_owner_all_go_at_once(limits, words):
    async def scenario(world):
        listener, _ = await world.join()
        _, sender = await world.join(*words)
        begin = world.loop.time()
        sender.write(FRAME * 2000)
        times = await world.hear(listener, 0x123, 2000)
        assert times[-1] - begin < 1e-3

    World(limits).run(scenario)


def test_who_does_not_know_the_word_is_no_owner():
    async def scenario(world):
        reader, writer = await world.loop.connect(PORT)
        await reader.readuntil(b">")
        for word in (b"< owner guess >", b"< owner  >", b"< owner >"):
            writer.write(word)
            assert await reader.readuntil(b">") == b"< error unknown command >"

    World(HubLimits(MBIT, "secret")).run(scenario)
    World(HubLimits(MBIT)).run(scenario)


def test_what_a_client_sent_before_it_left_goes_out():
    async def scenario(world):
        listener, _ = await world.join()
        _, sender = await world.join()
        sender.write(FRAME * 500)
        sender.close()
        assert len(await world.hear(listener, 0x123, 500)) == 500

    World(HubLimits(MBIT)).run(scenario)
