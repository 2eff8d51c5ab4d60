"""Devices that never come to an end: every transfer does, with one line that says why."""

import gc
import struct
import weakref

import can
import pytest

from device_profiles import ENCODER_406
from hil_drivers import DriverTimeoutError, Network, RemoteProtocolError, SdoAbortError
from hil_drivers.sdo_client import LONGEST_TRANSFER, MOST_BYTES

OUT_OF_MEMORY, TIMED_OUT = "05.00.04.05", "00.00.04.05"  # abort codes of CiA 301, little endian
NAME = (0x1008, 0)  # VISIBLE_STRING
POSITION = (0x6004, 0)  # INTEGER32
UNKNOWN = (0x5FFF, 1)  # in no EDS


class EndlessBus(can.BusABC):
    """A device of node-ID 4 that answers each frame as `server` says, in virtual time.

    Each answer takes `latency` [s]; an end of the tests' patience is 1,000,000 frames.
    """

    def __init__(self, server, latency):
        self.channel_info = "endless"
        self.server, self.latency = server, latency
        self.time, self.sent, self.waiting = 100.0, [], []
        super().__init__(channel="endless")

    def now(self):
        return self.time

    def send(self, msg, timeout=None):  # noqa: ARG002 - BusABC's
        assert len(self.sent) < 1_000_000
        self.sent.append(bytes(msg.data))
        self.waiting += self.server(bytes(msg.data))

    def recv(self, timeout=None):
        if self.waiting and timeout >= self.latency:
            self.time += self.latency
            data = self.waiting.pop(0)
            return can.Message(arbitration_id=0x584, data=data, is_extended_id=False)
        self.time += timeout
        return None

    @property
    def last(self):
        return self.sent[-1].hex(".").upper()


@pytest.fixture
def make_node():
    """A node behind such a bus; without an EDS it knows no data types."""
    buses = []

    def make(server, *, latency=0.001, eds=ENCODER_406):
        bus = EndlessBus(server, latency)
        buses.append(bus)
        return Network(bus, clock=bus.now).add_node(4, eds), bus

    yield make
    for bus in buses:
        bus.shutdown()


def initiated(request, size=None):
    """The answer to an upload request: segments follow."""
    command = 0x40 if size is None else 0x41
    return bytes([command]) + request[1:4] + struct.pack("<I", size or 0)


def endless_segments(size=None, segment=b"abcdefg"):
    """A server whose upload has no last segment (CiA 301, SDO upload segment)."""

    def serve(request):
        if request[0] == 0x80:
            return []
        if request[0] == 0x40:
            return [initiated(request, size)]
        toggle = request[0] & 0x10
        return [bytes([toggle | (7 - len(segment)) << 1]) + segment.ljust(7, b"\0")]

    return serve


def test_segments_without_end_are_aborted(make_node):
    node, bus = make_node(endless_segments())
    with pytest.raises(
        RemoteProtocolError,
        match=rf"^node 4: cannot read 0x1008 \(.*\): more than {MOST_BYTES} bytes came; it was",
    ):
        node.upload(*NAME)
    assert len(bus.sent) == 2 + MOST_BYTES // 7 + 1  # request and segments, and the abort
    assert bus.last == f"80.08.10.00.{OUT_OF_MEMORY}"


@pytest.mark.parametrize("size", [0, 1, 9, 20])
def test_more_than_was_announced_is_aborted(make_node, size):
    node, bus = make_node(endless_segments(size))
    with pytest.raises(RemoteProtocolError, match=f"more than {size} bytes came; it was aborted"):
        node.upload(*NAME)
    assert len(bus.sent) == 2 + size // 7 + 1
    assert bus.last.endswith(OUT_OF_MEMORY)


def test_an_announcement_beyond_the_bound_is_aborted_at_once(make_node):
    node, bus = make_node(endless_segments(MOST_BYTES + 1))
    with pytest.raises(
        RemoteProtocolError,
        match=f"{MOST_BYTES + 1} bytes are announced; {MOST_BYTES} are the most that is read",
    ):
        node.upload(*NAME)
    assert len(bus.sent) == 2


def test_the_bound_itself_is_read(make_node):
    sent = 0

    def serve(request):
        nonlocal sent
        if request[0] == 0x40:
            return [initiated(request, 21)]
        sent += 1
        return [bytes([request[0] & 0x10 | (sent == 3)]) + b"abcdefg"]

    node, _ = make_node(serve)
    node.sdo.most_bytes = 21
    assert node.upload(*NAME) == b"abcdefg" * 3


def test_a_number_of_the_eds_brings_few_bytes(make_node):
    node, bus = make_node(endless_segments())
    with pytest.raises(RemoteProtocolError, match="more than 8 bytes came"):
        node.read(*POSITION)
    assert len(bus.sent) == 4


def test_an_object_that_no_eds_knows_is_bounded_too(make_node):
    node, _ = make_node(endless_segments(), eds=None)
    node.sdo.most_bytes = 100
    with pytest.raises(RemoteProtocolError, match=r"0x5FFF\.01: more than 100 bytes came"):
        node.upload(*UNKNOWN)


def test_a_segment_that_brings_nothing_is_refused(make_node):
    node, bus = make_node(endless_segments(segment=b""))
    with pytest.raises(RemoteProtocolError, match="an empty segment came that is not the last one"):
        node.upload(*NAME)
    assert len(bus.sent) == 3


def test_fewer_bytes_than_announced_are_no_value(make_node):
    def serve(request):
        if request[0] == 0x40:
            return [initiated(request, 9)]
        return [bytes([request[0] & 0x10 | 1]) + b"abcdefg"]

    node, _ = make_node(serve)
    with pytest.raises(RemoteProtocolError, match="9 bytes are announced, 7 came"):
        node.upload(*NAME)


@pytest.mark.parametrize("latency", [0.49, 0.02])
def test_answers_just_before_each_time_out_do_not_go_on_for_ever(make_node, latency):
    node, bus = make_node(endless_segments(segment=b"a"), latency=latency)
    begin = bus.now()
    with pytest.raises(
        DriverTimeoutError,
        match=r"^node 4: cannot read 0x1008 \(.*\): not over within 60 s; it was aborted$",
    ):
        node.upload(*NAME)
    assert bus.now() - begin == pytest.approx(LONGEST_TRANSFER, abs=latency)
    assert bus.last == f"80.08.10.00.{TIMED_OUT}"


def test_a_download_that_is_confirmed_slowly_ends_too(make_node):
    def serve(request):
        if request[0] == 0x80:
            return []
        command = 0x60 if request[0] >> 5 == 1 else 0x20 | request[0] & 0x10
        return [bytes([command]) + (request[1:4] if command == 0x60 else bytes(3)) + bytes(4)]

    node, bus = make_node(serve, latency=0.49)
    with pytest.raises(DriverTimeoutError, match="not over within 60 s"):
        node.download(*NAME, bytes(1000))
    # 60 s are 122 answers; canopen asks once more to end what it had begun.
    assert len(bus.sent) < 130


def test_a_confirmation_of_another_object_confirms_nothing(make_node):
    node, _ = make_node(lambda _request: [bytes.fromhex("6005100000000000")])
    with pytest.raises(RemoteProtocolError, match=r"0x1017 .*confirms 0x1005\.00 instead"):
        node.write(0x1017, 0, 100)


def block_segments(numbers):
    """A server of a block upload (CiA 301) whose segments are numbered so; none is the last."""

    def serve(request):
        if request[0] & 0xE3 == 0xA0:  # initiate
            return [bytes([0xC0]) + request[1:4] + bytes(4)]
        if request[0] & 0xE3 in {0xA3, 0xA2}:  # start; the next sub-block
            return [bytes([number]) + b"abcdefg" for number in numbers]
        return []

    return serve


def test_a_block_without_end_is_aborted(make_node):
    node, bus = make_node(block_segments(range(1, 128)))
    node.sdo.most_bytes = 1000
    with (
        node.sdo.open(*NAME, block_transfer=True) as stream,
        pytest.raises(Exception, match="more than 1000 bytes came"),
    ):
        stream.read()
    # Twice the 1000 bytes, as segments may come again, and two of 7 bytes: the 288th is too many.
    assert bus.now() - 100.0 == pytest.approx((1 + 288) * bus.latency)
    assert bus.last == f"80.08.10.00.{OUT_OF_MEMORY}"


def test_a_block_that_is_never_in_order_is_aborted(make_node):
    node, _ = make_node(block_segments([1, 5]))
    node.sdo.most_bytes = 1000
    with (
        node.sdo.open(*NAME, block_transfer=True) as stream,
        pytest.raises(Exception, match="more than 1000 bytes came"),
    ):
        stream.read()


def test_a_flood_of_aborts_ends_one_transfer_and_not_the_next(make_node):
    node, bus = make_node(lambda _request: [bytes.fromhex("8004600000000408")] * 1000)
    with pytest.raises(SdoAbortError, match="0x08040000"):
        node.read(*POSITION)
    bus.server = lambda _request: [bytes.fromhex("4304600007000000")]
    bus.waiting.clear()
    assert node.read(*POSITION) == 7


def test_emergencies_without_end_hold_no_wait_up(make_node):
    node, bus = make_node(lambda _request: [])
    emergency = can.Message(arbitration_id=0x084, data=bytes(8), is_extended_id=False)

    def recv(timeout):
        bus.time += min(timeout, 0.0001)
        return emergency

    bus.recv = recv
    with pytest.raises(DriverTimeoutError, match=r"no SDO answer within 0\.5 s"):
        node.read(*POSITION)
    assert bus.now() < 100.6
    assert len(node.emergencies) == 32


@pytest.mark.parametrize(
    ("server", "error"),
    [
        (lambda _: [], DriverTimeoutError),
        (lambda _: [bytes.fromhex("8008100011000906")], SdoAbortError),  # 0x06090011
        (
            lambda request: (
                [request] if request[0] == 0x80 else [bytes.fromhex("60 081000 00000000")]
            ),
            RemoteProtocolError,  # the initiation is confirmed; segments are answered alike
        ),
    ],
    ids=["silent", "aborts", "other answer"],
)
def test_a_stream_whose_download_has_failed_sends_nothing_more(make_node, server, error):
    """Its stream is collected at any later time; a segment then would hit another transfer."""
    node, bus = make_node(server)
    with pytest.raises(error) as caught:
        node.download(*NAME, b"longer than four")
    sent = list(bus.sent)
    kept = weakref.ref(caught.value)
    del caught
    gc.collect()
    assert kept() is None
    assert bus.sent == sent
