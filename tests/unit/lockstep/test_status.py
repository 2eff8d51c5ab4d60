"""What is shown of a bench in lock-step, on a clock that is moved by hand."""

import pytest

from hil_bench.abilities.lockstep.lockstep import LockStep
from hil_bench.abilities.lockstep.run import LockStepStatus
from hil_bench.bench.assembly import build_bench
from hil_bench.bench.configuration import load_config
from hil_bench.bench.session import Session
from hil_bench.canopen_device.frame import Frame
from hil_bench.cli.status_line import format_lines
from hil_bench.outside.realtime.clock import VirtualClock
from hil_bench.outside.transports.transport import TransportCounters

SYNC = Frame(0x080)
TENTH = 100_000_000  # of a second [ns]


class Bus:
    def counters(self):
        return TransportCounters(received=1234, sent=567)


@pytest.fixture
def clock():
    return VirtualClock()


@pytest.fixture
def lockstep():
    bench = build_bench(load_config())
    bench.start(0)
    return LockStep(Session(bench), tick_ns=1_000_000)


@pytest.fixture
def status(lockstep, clock):
    return LockStepStatus(lockstep.session.bench, lockstep, Bus(), clock)


def shown(status):
    return format_lines(status.snapshot.read().values, status.lines)


def test_it_tells_how_far_and_how_fast_the_bench_goes(status, lockstep, clock):
    for _ in range(250):
        lockstep.receive(SYNC)
    clock.advance(TENTH)
    status.update()
    axis, progress = shown(status)
    assert axis.startswith("x ")
    assert progress == "0.2 s of bench time  2.5 times real time  in 1234  out 567"
    clock.advance(TENTH)
    status.update()
    assert "0.2 s of bench time  0.0 times real time" in shown(status)[1]


def test_ten_times_a_second_are_enough(status, clock):
    clock.advance(TENTH - 1)
    status.update()
    assert status.snapshot.read() is None
    clock.advance(1)
    status.update()
    assert status.snapshot.read().sequence == 1
