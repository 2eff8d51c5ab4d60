"""Which frames may be served between two ticks."""

import pytest

from hil_bench.bench.assembly import build_bench
from hil_bench.bench.configuration import load_config
from hil_bench.canopen_device.frame import Frame

TICK = 1_000_000
SDO_REQUEST = Frame(0x601, bytes.fromhex("4000100000000000"))


@pytest.fixture
def bench():
    """The built-in bench after its first tick, in which its nodes boot."""
    bench = build_bench(load_config())
    bench.start(0)
    bench.tick([], 0)
    return bench


@pytest.mark.parametrize(
    ("frame", "is_timeless"),
    [
        (SDO_REQUEST, True),
        (Frame(0x000, b"\x01\x00"), False),  # NMT
        (Frame(0x080), False),  # SYNC
        (Frame(0x201, bytes(4)), False),  # RPDO 1 of the valve
        (Frame(0x701, is_remote=True), False),  # node guarding
        (Frame(0x7E5, bytes(8)), False),  # LSS
        (Frame(0x7FF), True),  # nobody listens to it
        (Frame(0x080, is_extended=True), True),  # nor to this
    ],
)
def test_sdo_requests_and_what_is_for_nobody_are_timeless(bench, frame, is_timeless):
    assert bench.is_timeless(frame) is is_timeless


def test_nothing_is_while_a_frame_of_our_own_waits_for_the_next_tick(bench):
    # Node 1 watches the heartbeat of node 2 (0x1016.01: 1000 ms), which comes with each tick
    # (0x1017: 1 ms) and is heard in the one after.
    watch, beat = "23161001e8030200", "2b17100001000000"
    bench.tick([Frame(0x601, bytes.fromhex(watch)), Frame(0x602, bytes.fromhex(beat))], TICK)
    for number in (2, 3):
        sent = bench.tick([], number * TICK)
        assert 0x702 in [frame.can_id for frame in sent]
        assert not bench.is_timeless(SDO_REQUEST)
