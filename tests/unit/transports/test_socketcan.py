"""The fast path on sockets that keep message boundaries as a raw CAN socket does.

A socket pair carries `struct can_frame`; loopback UDP has the kernel's drop counter; a fake has the
errors. The same transport on a real interface is tested in tests/socketcan.
"""

import errno
import socket
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.patience import GUARD

from hil_bench.canopen_device.frame import BRS, ESI, FDF, Frame
from hil_bench.errors import BusError
from hil_bench.frame import FD_LENGTHS
from hil_bench.outside.transports.socketcan import (
    RETRY_LIMIT,
    SocketCanTransport,
    pack_filters,
    pack_frame,
    unpack_frame,
)
from hil_bench.outside.transports.transport import TransportCounters

# linux/can.h: EFF, RTR and ERR are bits 31, 30 and 29 of can_id; struct can_frame is can_id (4),
# length (1), padding (3), data (8); struct canfd_frame is 72 byte long.
EFF, RTR, ERR = 0x8000_0000, 0x4000_0000, 0x2000_0000


def can_frame(can_id, length, data=b""):
    return struct.pack("=IBBBB", can_id, length, 0, 0, 0) + data.ljust(8, b"\x00")


def fd_frame(can_id, length, flags, data=b""):
    """struct canfd_frame, as linux/can.h has it."""
    return struct.pack("=IBBBB", can_id, length, flags, 0, 0) + data.ljust(64, b"\0")


class FakeBus:
    """Stands for python-can's `SocketcanBus`."""

    def __init__(self, sock):
        self.socket = sock
        self.shutdowns = 0

    def shutdown(self):
        self.shutdowns += 1
        self.socket.close()


@pytest.fixture
def wire():
    """A transport and the far end of its wire."""
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    transport = SocketCanTransport(FakeBus(near), "vcan0")
    far.settimeout(GUARD)
    yield transport, far
    transport.close()
    far.close()


@pytest.mark.parametrize(
    ("frame", "raw"),
    [
        (Frame(0x123, b"\xde\xad"), can_frame(0x123, 2, b"\xde\xad")),
        (Frame(0x7FF), can_frame(0x7FF, 0)),
        (Frame(0x80, bytes(range(8))), can_frame(0x80, 8, bytes(range(8)))),
        (Frame(0x12345678, b"\x01", is_extended=True), can_frame(0x12345678 | EFF, 1, b"\x01")),
        (Frame(0x701, is_remote=True), can_frame(0x701 | RTR, 0)),
        (Frame(5, is_remote=True, is_extended=True), can_frame(5 | RTR | EFF, 0)),
        (Frame(0x123, b"", fd=FDF), fd_frame(0x123, 0, 4)),
        (Frame(0x123, bytes(range(12)), fd=FDF | BRS), fd_frame(0x123, 12, 5, bytes(range(12)))),
        (Frame(5, b"x" * 64, False, True, 0, FDF | ESI), fd_frame(5 | EFF, 64, 6, b"x" * 64)),
    ],
)
def test_a_frame_has_the_layout_of_the_kernel(frame, raw):
    assert pack_frame(frame) == raw
    assert unpack_frame(raw) == frame


def test_a_remote_frame_keeps_no_data_whatever_length_it_asks_for():
    assert unpack_frame(can_frame(0x701 | RTR, 8, b"12345678")) == Frame(0x701, is_remote=True)


@pytest.mark.parametrize(
    "raw",
    [
        fd_frame(0x123, 9, 0),
        fd_frame(0x123, 65, 0),
        fd_frame(0x123 | RTR, 0, 0),
        can_frame(0x004 | ERR, 8),
        can_frame(0x123, 9),
        b"",
        bytes(15),
    ],
    ids=["fd of 9", "fd of 65", "fd remote", "error", "length over 8", "empty", "short"],
)
def test_what_is_no_frame_is_none(raw):
    assert unpack_frame(raw) is None


@given(st.binary(max_size=80))
def test_any_bytes_give_a_legal_frame_or_none(raw):
    frame = unpack_frame(raw)
    if frame is not None:
        assert 0 <= frame.can_id <= (0x1FFF_FFFF if frame.is_extended else 0x7FF)
        assert len(frame.data) in (FD_LENGTHS if frame.fd else range(9))


def test_frames_arrive_in_order_and_not_more_than_the_limit(wire):
    transport, far = wire
    for can_id in (1, 2, 3):
        far.send(can_frame(can_id, 1, b"\x55"))
    assert transport.receive(2) == [Frame(1, b"\x55"), Frame(2, b"\x55")]
    assert transport.receive(2) == [Frame(3, b"\x55")]
    assert transport.receive(2) == []
    assert transport.counters() == TransportCounters(received=3)


def test_error_frames_are_counted_and_bound_the_work_too(wire):
    transport, far = wire
    for raw in (bytes(71), can_frame(4 | ERR, 8), can_frame(9, 0)):
        far.send(raw)
    assert transport.receive(2) == []
    assert transport.receive(2) == [Frame(9)]
    assert transport.counters() == TransportCounters(received=1, ignored=2)


def test_frames_are_sent_in_order(wire):
    transport, far = wire
    transport.send([Frame(1, b"a"), Frame(2, is_remote=True)])
    assert [far.recv(100), far.recv(100)] == [can_frame(1, 1, b"a"), can_frame(2 | RTR, 0)]
    assert transport.counters() == TransportCounters(sent=2)


@pytest.mark.parametrize(
    ("frame", "least"),
    [
        (Frame(1, bytes(8)), 111),  # CAN 2.0: 47 bits and the data, without stuff bits
        (Frame(0x18FEF100, bytes(8), is_extended=True), 131),  # 67 bits and the data
    ],
)
def test_bits_count_by_the_kind_of_identifier_both_ways(wire, frame, least):
    transport, far = wire
    transport.send([frame])
    sent = transport.counters().bits
    assert least <= sent < 1.25 * least  # a stuff bit behind four others at most
    far.send(far.recv(100))
    transport.receive(1)
    assert transport.counters().bits == pytest.approx(2 * sent)


def test_the_receive_buffer_is_enlarged_and_what_was_granted_is_known(wire):
    transport, far = wire
    assert transport.receive_buffer > far.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)


def test_a_full_queue_makes_frames_wait_in_order_and_gives_up_the_oldest(wire):
    transport, far = wire
    sent = 0
    while transport.counters().sent == sent:  # until the kernel's buffer takes no more
        transport.send([Frame(1, sent.to_bytes(4, "little"))])
        sent += 1
    # One frame waits; as many as the limit more push it and nothing else out.
    transport.send([Frame(2, n.to_bytes(4, "little")) for n in range(RETRY_LIMIT)])
    assert transport.counters() == TransportCounters(sent=sent - 1, send_failures=1)

    for n in range(sent - 1):
        assert far.recv(100) == can_frame(1, 4, n.to_bytes(4, "little"))
    transport.send([])
    for n in range(RETRY_LIMIT):
        assert far.recv(100) == can_frame(2, 4, n.to_bytes(4, "little"))
    assert transport.counters().sent == sent - 1 + RETRY_LIMIT


def test_closing_shuts_the_bus_down():
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    bus = FakeBus(near)
    SocketCanTransport(bus, "vcan0").close()
    assert bus.shutdowns == 1
    far.close()


def test_what_the_kernel_drops_is_counted():
    near = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    near.bind(("127.0.0.1", 0))
    transport = SocketCanTransport(FakeBus(near), "vcan0")
    near.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)  # the kernel's minimum
    far = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    far.connect(near.getsockname())
    for _ in range(100):
        far.send(can_frame(1, 0))
    kept = len(transport.receive(200))
    assert 0 < kept < 100
    # The counter comes with the frames that are queued after the loss.
    far.send(can_frame(2, 0))
    assert transport.receive(200) == [Frame(2)]
    assert transport.counters().dropped == 100 - kept
    transport.close()
    far.close()


class FakeSocket:
    """Answers from lists: what `recvmsg` returns or raises, what `send` raises."""

    def __init__(self, *, received=(), send_errors=(), so_error=0, force_allowed=True):
        self.received = list(received)
        self.send_errors = list(send_errors)
        self.so_error = so_error
        self.force_allowed = force_allowed
        self.sent = []
        self.options = []

    def setblocking(self, flag):
        assert flag is False

    def setsockopt(self, level, option, value):
        if option == 33 and not self.force_allowed:  # SO_RCVBUFFORCE
            raise PermissionError(errno.EPERM, "not permitted")
        self.options.append((level, option, value))

    def getsockopt(self, _level, option):
        return {socket.SO_ERROR: self.so_error, socket.SO_RCVBUF: 425_984}[option]

    def recvmsg(self, _size, _ancillary_size):
        if not self.received:
            raise BlockingIOError(errno.EAGAIN, "again")
        answer = self.received.pop(0)
        if isinstance(answer, OSError):
            raise answer
        return answer

    def send(self, raw):
        code = self.send_errors.pop(0) if self.send_errors else 0
        if code:
            raise OSError(code, "fake")
        self.sent.append(raw)


def with_drops(can_id, counter):
    ancillary = [
        (socket.SOL_SOCKET, 35, bytes(16)),  # SO_TIMESTAMPNS
        (socket.SOL_SOCKET, 40, struct.pack("=I", counter)),  # SO_RXQ_OVFL
    ]
    return can_frame(can_id, 0), ancillary, 0, ("vcan0",)


def test_the_drop_counter_may_wrap_around():
    fake = FakeSocket(received=[with_drops(1, 2**32 - 10), with_drops(2, 2**32 - 10)])
    transport = SocketCanTransport(FakeBus(fake), "vcan0")
    transport.receive(10)
    assert transport.counters().dropped == 2**32 - 10
    fake.received = [with_drops(3, 5)]
    transport.receive(10)
    assert transport.counters().dropped == 2**32 + 5


@pytest.mark.parametrize("code", [errno.EAGAIN, errno.ENOBUFS])
def test_a_queue_that_is_full_for_a_moment_costs_nothing(code):
    fake = FakeSocket(send_errors=[0, code])
    transport = SocketCanTransport(FakeBus(fake), "vcan0")
    transport.send([Frame(1), Frame(2), Frame(3)])
    assert fake.sent == [can_frame(1, 0)]
    transport.send([Frame(4)])
    assert fake.sent == [can_frame(n, 0) for n in (1, 2, 3, 4)]
    assert transport.counters() == TransportCounters(sent=4)


@pytest.mark.parametrize(
    ("code", "text"),
    [
        (errno.ENODEV, "socketcan vcan7: bus lost: the interface is gone"),
        (errno.EIO, "socketcan vcan7: bus lost: Input/output error"),
    ],
)
def test_a_lost_bus_is_said(code, text):
    for use in (lambda bus: bus.send([Frame(1)]), lambda bus: bus.receive(1)):
        far = FakeSocket(send_errors=[code], received=[OSError(code, "fake")])
        with pytest.raises(BusError) as caught:
            use(SocketCanTransport(FakeBus(far), "vcan7"))
        assert str(caught.value).startswith(text)


@pytest.fixture
def interface(monkeypatch):
    """What the kernel says of the interface."""
    state = {"is_up": False}
    monkeypatch.setattr(
        "hil_bench.outside.transports.socketcan.is_up", lambda _name: state["is_up"]
    )
    return state


def test_an_interface_that_goes_down_is_told_once_and_waited_for(interface, caplog):
    down = [OSError(errno.ENETDOWN, "fake"), *[BlockingIOError()] * 60]
    fake = FakeSocket(received=down, send_errors=[errno.ENETDOWN] * 2)
    transport = SocketCanTransport(FakeBus(fake), "vcan7")
    for _ in range(25):
        assert transport.receive(1) == []
    transport.send([Frame(1), Frame(2)])
    transport.send([Frame(3)])
    counters = transport.counters()
    assert (counters.is_down, counters.outages, counters.send_failures) == (True, 1, 3)
    interface["is_up"] = True
    for _ in range(20):
        transport.receive(1)
    assert not transport.counters().is_down
    # What was given up while it was down does not come late.
    transport.send([Frame(4)])
    assert fake.sent == [can_frame(4, 0)]
    down, up = caplog.messages[-2:]
    assert down.startswith("socketcan vcan7: the interface is down; 'ip link set vcan7 up' starts")
    assert up == "socketcan vcan7: the interface is up again"
    assert sum("is down" in message for message in caplog.messages) == 1


class SleepySocket(FakeSocket):
    """One that `select` finds nothing in."""

    def fileno(self):
        return self.near.fileno()


def test_who_waits_long_for_an_interface_that_is_down_is_told_at_once(interface, caplog):
    sleepy = SleepySocket(received=[OSError(errno.ENETDOWN, "fake")])
    sleepy.near, far = socket.socketpair()
    transport = SocketCanTransport(FakeBus(sleepy), "vcan7")
    transport.receive(1)
    assert not transport.wait(0.02)
    assert transport.counters().is_down
    interface["is_up"] = True
    assert not transport.wait(0.001)  # who waits often asks seldom
    assert transport.counters().is_down
    assert not transport.wait(0.02)
    assert not transport.counters().is_down
    assert caplog.messages[-1] == "socketcan vcan7: the interface is up again"
    sleepy.near.close()
    far.close()


def test_an_interface_that_is_down_is_refused_at_once():
    with pytest.raises(
        BusError, match=r"^socketcan vcan7: the interface is down; 'ip link set vca"
    ):
        SocketCanTransport(FakeBus(FakeSocket(so_error=errno.ENETDOWN)), "vcan7")


def test_without_the_privilege_the_receive_buffer_is_asked_for_politely():
    fake = FakeSocket(force_allowed=False)
    transport = SocketCanTransport(FakeBus(fake), "vcan0")
    assert (socket.SOL_SOCKET, socket.SO_RCVBUF, 8 * 1024 * 1024) in fake.options
    assert transport.receive_buffer == 425_984


def test_filters_name_each_identifier_once_for_data_and_remote_frames():
    # struct can_filter is can_id, can_mask; a mask without RTR matches both kinds of frame, one
    # with EFF set against an identifier without it matches 11-bit frames only.
    assert pack_filters([0x601, 0x000, 0x601]) == struct.pack(
        "=IIII", 0x000, 0x7FF | EFF, 0x601, 0x7FF | EFF
    )
    assert pack_filters([]) == b""


def test_more_identifiers_than_the_kernel_takes_open_the_filter():
    assert len(pack_filters(range(512))) == 512 * 8
    assert pack_filters(range(513)) == struct.pack("=II", 0, 0)


def test_listening_sets_the_raw_sockets_filter():
    fake = FakeSocket()
    SocketCanTransport(FakeBus(fake), "vcan0").listen_to({0x80: "sync"})
    # linux/can/raw.h: SOL_CAN_RAW is 101, CAN_RAW_FILTER is 1.
    assert fake.options[-1] == (101, 1, struct.pack("=II", 0x80, 0x7FF | EFF))


def test_a_refused_filter_is_a_lost_bus(wire):
    transport, _ = wire  # a Unix socket knows no CAN filters
    with pytest.raises(BusError, match=r"^socketcan vcan0: bus lost: "):
        transport.listen_to([1])


@pytest.mark.parametrize(
    ("granted", "warnings"),
    [(8 * 1024 * 1024, 0), (425_984, 1)],  # 425,984: twice the default rmem_max, as it is reported
)
def test_a_small_receive_buffer_is_told(monkeypatch, caplog, granted, warnings):
    monkeypatch.setattr(
        "hil_bench.outside.transports.socketcan._enlarge_receive_buffer", lambda _socket: granted
    )
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    SocketCanTransport(FakeBus(near), "vcan0").close()
    far.close()
    assert len(caplog.messages) == warnings
    assert all("receive buffer of 416 KiB" in message for message in caplog.messages)


def test_a_wait_ends_with_a_frame_or_without(wire):
    transport, far = wire
    assert not transport.wait(0.0)
    far.send(can_frame(0x123, 0))
    assert transport.wait(GUARD)
    assert transport.receive(2) == [Frame(0x123)]
    assert not transport.wait(0.0)
