"""When a controller in lock-step is given up; each look at the bus takes time on a fake clock."""

import pytest

from hil_bench.abilities.lockstep.firmware import USUAL_PATIENCE, LockStepLink, Patience
from hil_bench.abilities.lockstep.lockstep import LockStep
from hil_bench.bench.assembly import build_bench
from hil_bench.bench.configuration import load_config
from hil_bench.bench.session import Session
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import ControllerError
from hil_bench.outside.realtime.clock import VirtualClock

SYNC = Frame(0x080)
HEARTBEAT = Frame(0x77F, b"\x05")
SECOND = 1_000_000_000


class Bus:
    """Brings a frame with each wait, or none; each wait takes as long as it is told."""

    def __init__(self, clock):
        self.clock = clock
        self.frame = None
        self.takes = SECOND // 10

    def wait(self, timeout):
        assert timeout == 0.1
        self.clock.advance(self.takes)
        return self.frame is not None

    def receive(self, _limit):
        return [self.frame]

    def send(self, frames):
        pass


@pytest.fixture
def bus():
    return Bus(VirtualClock())


def make_link(bus, patience=USUAL_PATIENCE):
    bench = build_bench(load_config())
    bench.start(0)
    lockstep = LockStep(Session(bench), tick_ns=1_000_000)
    return LockStepLink(lockstep, bus, patience, clock=bus.clock)


@pytest.fixture
def link(bus):
    return make_link(bus)


def steps_until_given_up(link):
    """Return how many steps went well, and why no more did."""
    for count in range(10_000):
        try:
            link.step()
        except ControllerError as error:
            return count, str(error)
    raise AssertionError("never given up")


RIGHT = (
    " for 20 s, and without SYNC bench time stands still; let the controller on this bus send SYNC "
    "(as producer: bit 30 of 0x1005, 0x1006)"
)


def test_a_controller_that_says_nothing_is_given_up_after_20_s(link):
    count, why = steps_until_given_up(link)
    assert why == f"nobody has sent a frame{RIGHT}"
    assert count == pytest.approx(200, abs=1)


def test_so_is_one_that_says_all_but_sync(link, bus):
    bus.frame = HEARTBEAT
    count, why = steps_until_given_up(link)
    assert why == f"frames, but no SYNC (0x080){RIGHT}"
    assert count == pytest.approx(200, abs=1)


def test_the_patience_is_a_choice_and_says_what_else_would_be_right(bus):
    link = make_link(bus, Patience(1.0, ", or wait longer"))
    count, why = steps_until_given_up(link)
    assert why.startswith("nobody has sent a frame for 1 s, ")
    assert why.endswith("0x1006), or wait longer")
    assert count == pytest.approx(10, abs=1)


def test_any_sync_is_a_sign_of_life(link, bus):
    for _ in range(50):
        bus.frame = SYNC
        link.step()
        bus.frame = None
        for _ in range(100):
            link.step()
    assert link.now == 50_000_000


def test_frames_that_come_fast_do_not_use_patience_up_faster(bus):
    """A frame a millisecond, and no SYNC: 1 s of patience is 1000 of them."""
    link = make_link(bus, Patience(1.0, ""))
    bus.frame, bus.takes = HEARTBEAT, SECOND // 1000
    assert steps_until_given_up(link)[0] == pytest.approx(1000, abs=1)


def test_a_suspended_machine_is_not_the_controllers_fault(link, bus):
    bus.takes = 3600 * SECOND
    for _ in range(100):
        link.step()
    bus.takes = SECOND // 10
    # What was waited for is 0.1 s a step, however long the process slept in it.
    assert steps_until_given_up(link)[0] == pytest.approx(100, abs=1)
