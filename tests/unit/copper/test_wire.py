"""How long a bus of copper takes; who sends when is in test_plain_wire. A bit is 1 us."""

import pytest

from hil_bench.abilities.copper.wire.bits import exact_bits
from hil_bench.abilities.copper.wire.station import Station
from hil_bench.abilities.copper.wire.wire import Wire
from hil_bench.canopen_device.frame import Frame
from hil_bench.frame import priority

US = 1000
LONG = 10**12


def rig(bitrate):
    stations = [Station("a", 8), Station("b", 8)]
    return Wire(bitrate, stations), *stations


def test_an_idle_bus_sends_at_once():
    wire, a, _ = rig(125_000)
    assert wire.run(5_000_000) == []
    wire.put(a, Frame(0x80), 5_000_000)
    (sent,) = wire.run(LONG)
    assert (sent.begin, sent.end) == (5_000_000, 5_000_000 + 8 * US * exact_bits(Frame(0x80)))


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
    wire, a, _ = rig(bitrate)
    frame, now = Frame(0x181, b"\x55" * 8), 0
    wire.put(a, frame, 0)
    for _ in range(1000):
        now = wire.advance(LONG).end
        wire.put(a, frame, now)
    exact = 1000 * exact_bits(frame) * 1e9 / bitrate
    assert abs(now - exact) <= 1000  # a nanosecond a frame
