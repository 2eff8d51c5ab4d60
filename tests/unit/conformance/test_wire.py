"""Frames stay in the inbox until somebody takes them."""

import can
import pytest

from hil_bench.abilities.conformance.verdicts import NotApplicable
from hil_bench.abilities.conformance.wire import BACKLOG, Wire
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import BusError
from hil_bench.outside.transports.embedded import EmbeddedBus


def by(can_id):
    return lambda frame: frame.can_id == can_id


@pytest.fixture
def script():
    """What the other side sends, by tick of 1 ms."""
    return {}


@pytest.fixture
def wire(script):
    with EmbeddedBus(lambda _frames, now: script.get(now // 1_000_000, ())) as bus:
        yield Wire(bus, bus.now)


def test_frames_are_taken_in_any_order(wire, script):
    script.update({1: [Frame(1), Frame(2)], 2: [Frame(1, b"\x05")]})
    assert wire.take(by(2), 0.01).frame == Frame(2)
    first, second = wire.take(by(1), 0.01), wire.take(by(1), 0.01)
    assert (first.frame, second.frame) == (Frame(1), Frame(1, b"\x05"))
    assert second.time - first.time == pytest.approx(0.001)
    assert wire.take(by(1), 0.01) is None


def test_a_wait_that_nobody_ends_takes_its_time(wire):
    begin = wire.now()
    assert wire.take(by(1), 0.25) is None
    assert wire.now() - begin == pytest.approx(0.25)


def test_take_all_waits_for_the_whole_time(wire, script):
    script.update({3: [Frame(1)], 5: [Frame(2)], 9: [Frame(1)]})
    assert [arrival.frame for arrival in wire.take_all(by(1), 0.02)] == [Frame(1), Frame(1)]
    assert wire.take(by(2), 0.0).frame == Frame(2)


def test_forgotten_frames_are_gone(wire, script):
    script.update({1: [Frame(1)]})
    wire.wait(0.002)
    wire.forget()
    assert wire.take(by(1), 0.01) is None


def test_a_bus_without_remote_frames_decides_nothing_by_their_silence(monkeypatch, wire):
    """Node guarding failed on each hub, and a check that silence is right passed."""
    monkeypatch.setattr(wire._bus, "carries_remote", False, raising=False)
    wire.send(Frame(0x80))
    with pytest.raises(NotApplicable, match="this bus has no remote frames"):
        wire.send(Frame(0x80), Frame(0x701, is_remote=True))


def test_error_frames_and_can_fd_are_nobodys(monkeypatch, wire):
    messages = [
        can.Message(is_error_frame=True),
        can.Message(arbitration_id=1, is_fd=True, data=bytes(12), is_extended_id=False),
    ]
    monkeypatch.setattr(wire._bus, "recv", lambda _timeout: messages.pop() if messages else None)
    assert wire.take(lambda _frame: True, 0.0) is None


def test_a_lost_bus_is_told(wire):
    wire._bus.shutdown()
    with pytest.raises(BusError, match="shut down"):
        wire.send(Frame(1))
    with pytest.raises(BusError, match="shut down"):
        wire.wait(0.1)


@pytest.mark.parametrize(
    "wait", [lambda wire: wire.take(by(2), 0.01), lambda wire: wire.wait(0.01)]
)
def test_a_flood_that_never_ends_holds_no_wait_up(monkeypatch, wire, wait):
    taken = 0

    def flood(_timeout):
        nonlocal taken
        taken += 1
        assert taken < 100_000
        return can.Message(arbitration_id=1, is_extended_id=False)

    clock = iter(range(1_000_000))
    monkeypatch.setattr(wire._bus, "recv", flood)
    monkeypatch.setattr(wire, "now", lambda: next(clock) * 1e-3)  # each look at it takes 1 ms
    assert wait(wire) is None
    assert BACKLOG <= taken < BACKLOG + 50  # what had come by then, and the frames of 10 ms
