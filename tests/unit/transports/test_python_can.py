import itertools

import can
import pytest

from hil_bench.canopen_device.frame import BRS, ESI, FDF, Frame
from hil_bench.errors import BusError
from hil_bench.frame import FD_LENGTHS
from hil_bench.outside.messages import frame_of, message_of
from hil_bench.outside.transports.opening import PythonCanTransport
from hil_bench.outside.transports.transport import TransportCounters


class ScriptedBus(can.BusABC):
    """Gives or raises what `received` holds; raises what `send_errors` holds."""

    def __init__(self, received=(), send_errors=()):
        super().__init__("scripted")
        self.received = list(received)
        self.send_errors = list(send_errors)
        self.sent = []
        self.waits = []
        self.is_filtering = True

    def _recv_internal(self, timeout):
        self.waits.append(timeout)
        if not self.received:
            return None, self.is_filtering
        answer = self.received.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer, self.is_filtering

    def send(self, msg, timeout=None):
        assert timeout is None
        error = self.send_errors.pop(0) if self.send_errors else None
        if error is not None:
            raise error
        self.sent.append(msg)


@pytest.fixture
def make_transport():
    transports = []

    def make(**script):
        bus = ScriptedBus(**script)
        transports.append(PythonCanTransport(bus, "virtual test"))
        return transports[-1], bus

    yield make
    for transport in transports:
        transport.close()


def message(can_id, **fields):
    return can.Message(arbitration_id=can_id, is_extended_id=False, **fields)


def test_a_frame_survives_the_way_through_a_message():
    frames = [
        Frame(0x7FF, bytes(8)),
        Frame(0x0),
        Frame(0x701, is_remote=True),
        Frame(0x1FFF_FFFF, b"\x01", is_extended=True),
        *(Frame(0x123, bytes(n), fd=FDF | BRS) for n in FD_LENGTHS),
        Frame(0x1FFF_FFFF, bytes(64), is_extended=True, fd=FDF | ESI),
    ]
    assert [frame_of(message_of(frame)) for frame in frames] == frames


def test_frames_arrive_in_order_and_not_more_than_the_limit(make_transport):
    transport, _ = make_transport(received=[message(n, data=b"x") for n in (1, 2, 3)])
    assert transport.receive(2) == [Frame(1, b"x"), Frame(2, b"x")]
    assert transport.receive(2) == [Frame(3, b"x")]
    assert transport.receive(2) == []
    assert transport.counters() == TransportCounters(received=3)


@pytest.mark.parametrize(
    "foreign",
    [
        message(1, is_fd=True, data=bytes(64)),
        message(1, is_fd=True),
        message(1, is_error_frame=True),
        message(1, data=bytes(9)),
        message(0x800),
        message(-1),
    ],
    ids=["fd", "short fd", "error frame", "nine bytes", "12-bit identifier", "negative"],
)
def test_what_is_no_classical_frame_is_ignored_and_counted(make_transport, foreign):
    transport, _ = make_transport(received=[foreign, message(2)])
    assert transport.receive(10) == [Frame(2)]
    assert transport.counters() == TransportCounters(received=1, ignored=1)


def test_a_classical_bus_says_once_that_it_ignores_can_fd(make_transport, caplog):
    foreign = [message(1, is_fd=True, data=bytes(64)), message(2, is_fd=True)]
    transport, _ = make_transport(received=foreign)
    transport.receive(10)
    (record,) = caplog.records
    assert "frames of CAN FD arrive and are ignored; fd = true" in record.getMessage()


def test_a_bus_of_can_fd_takes_both_kinds():
    bus = ScriptedBus([message(1, is_fd=True, data=bytes(64), bitrate_switch=True), message(2)])
    transport = PythonCanTransport(bus, "a bus", speedup=8.0)
    assert transport.receive(10) == [Frame(1, bytes(64), fd=FDF | BRS), Frame(2)]


def test_a_flood_of_foreign_frames_is_bounded_too(make_transport):
    transport, bus = make_transport(received=[message(1, is_error_frame=True)] * 50)
    assert transport.receive(10) == []
    assert len(bus.received) == 40


def test_frames_are_sent_in_order(make_transport):
    transport, bus = make_transport()
    transport.send([Frame(1, b"a"), Frame(0x12345, b"b", is_extended=True)])
    assert [(m.arbitration_id, bytes(m.data), m.is_extended_id) for m in bus.sent] == [
        (1, b"a", False),
        (0x12345, b"b", True),
    ]
    assert transport.counters() == TransportCounters(sent=2)


def test_a_frame_that_is_refused_is_counted_and_the_next_one_sent(make_transport):
    transport, bus = make_transport(send_errors=[can.CanOperationError("Transmit buffer full")])
    transport.send([Frame(1), Frame(2)])
    assert [m.arbitration_id for m in bus.sent] == [2]
    assert transport.counters() == TransportCounters(sent=1, send_failures=1)


@pytest.mark.parametrize(
    "error",
    [
        can.CanOperationError("gone"),
        can.CanError("gone"),
        OSError("gone"),
        ValueError("gone"),
        can.CanOperationError("gone  Traceback (most recent call last):\n  File x"),  # socketcand
    ],
)
def test_an_error_while_receiving_is_a_lost_bus(make_transport, error):
    transport, _ = make_transport(received=[error])
    with pytest.raises(BusError, match=r"^virtual test: bus lost: gone$"):
        transport.receive(1)


@pytest.mark.parametrize("error", [can.CanInitializationError("gone"), BrokenPipeError("gone")])
def test_an_error_while_sending_is_a_lost_bus(make_transport, error):
    transport, _ = make_transport(send_errors=[error])
    with pytest.raises(BusError, match=r"^virtual test: bus lost: gone$"):
        transport.send([Frame(1)])


def test_listening_leaves_all_frames_through(make_transport):
    transport, _ = make_transport(received=[message(1)])
    transport.listen_to([2])
    assert transport.receive(1) == [Frame(1)]


def test_two_transports_meet_on_python_cans_virtual_bus():
    names = {"interface": "virtual", "channel": "test_python_can", "ignore_config": True}
    left = PythonCanTransport(can.Bus(**names), "left")
    right = PythonCanTransport(can.Bus(**names), "right")
    left.send([Frame(0x181, b"\x01\x02")])
    assert right.receive(10) == [Frame(0x181, b"\x01\x02")]
    assert left.receive(10) == []
    left.close()
    left.close()
    right.close()


def test_receiving_never_waits(make_transport):
    transport, bus = make_transport(received=[message(0x123)])
    transport.receive(8)
    assert bus.waits == [0, 0]


def test_a_message_that_ended_a_wait_is_received_first(make_transport):
    transport, bus = make_transport(received=[message(0x123), message(0x124)])
    assert transport.wait(0.5)
    assert transport.wait(0.5)  # it is still there: no second one is taken
    assert [frame.can_id for frame in transport.receive(8)] == [0x123, 0x124]
    assert transport.counters().received == 2
    assert bus.waits[0] == pytest.approx(0.5)


def test_a_wait_ends_without_a_message(make_transport):
    transport, _ = make_transport()
    assert not transport.wait(0.0)
    assert transport.receive(1) == []


def test_a_system_clock_that_is_set_back_prolongs_no_wait(make_transport, monkeypatch):
    clock = itertools.count(1e9, -3600.0)  # an hour less at each look
    monkeypatch.setattr("can.bus.time", lambda: next(clock))
    transport, bus = make_transport()
    assert not transport.wait(0.001)
    assert transport.receive(1) == []
    assert bus.waits == [0.001, 0]


def test_filters_that_the_bus_leaves_to_python_can_are_kept(make_transport):
    transport, bus = make_transport(received=[message(0x123), message(0x124)])
    bus.set_filters([{"can_id": 0x124, "can_mask": 0x7FF}])
    bus.is_filtering = False
    assert transport.receive(1) == []
    assert transport.receive(1) == [Frame(0x124)]


def test_a_bus_lost_while_waiting_is_told(make_transport):
    transport, _ = make_transport(received=[can.CanOperationError("unplugged")])
    with pytest.raises(BusError, match=r"^virtual test: bus lost: unplugged$"):
        transport.wait(0.5)


@pytest.mark.parametrize("is_exact", [False, True])
def test_whether_its_wait_is_exact_is_for_who_opens_it_to_say(is_exact):
    assert PythonCanTransport(None, "test", has_exact_wait=is_exact).has_exact_wait is is_exact
