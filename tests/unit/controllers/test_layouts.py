"""The memory shared with a program and a library, by the structures of their C headers."""

import ctypes as c
import mmap
import random

import pytest

from hil_bench.abilities.common.processes import ProcessStatus
from hil_bench.abilities.controllers import patience
from hil_bench.abilities.controllers.library.controller import _FRAME, LibraryController, State
from hil_bench.abilities.controllers.program import controller as program
from hil_bench.abilities.controllers.program.exchange import RING, Exchange
from hil_bench.abilities.controllers.seam import ControllerEnd, TimedFrame
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import ControllerError

EXTENDED, REMOTE = 1 << 31, 1 << 30  # of SocketCAN


class Record(c.Structure):
    """`struct record` of bench.h."""

    _fields_ = (
        ("time", c.c_int64), ("id", c.c_uint32), ("length", c.c_uint8), ("bus", c.c_uint8),
        ("unused", c.c_uint8 * 2), ("data", c.c_uint8 * 8),
    )  # fmt: skip


class Shared(c.Structure):
    """`struct exchange` of bench.h."""

    _fields_ = (
        ("version", c.c_uint32), ("grant", c.c_uint32), ("until", c.c_int64),
        ("in_head", c.c_uint32), ("out_tail", c.c_uint32), ("buses", c.c_uint16),
        ("is_real", c.c_uint16), ("heard", c.c_uint32), ("names", c.c_char * 16 * 16),
        ("now", c.c_int64), ("wake", c.c_int64), ("in_tail", c.c_uint32), ("out_head", c.c_uint32),
        ("answered", c.c_uint32), ("state", c.c_uint32), ("holder", c.c_int32),
        ("random", c.c_uint32), ("calls", c.c_uint32), ("refusal", c.c_char * 172),
        ("received", Record * 4096), ("sent", Record * 4096),
    )  # fmt: skip


@pytest.fixture
def both(request):
    """An exchange, and the structure on the same memory."""
    exchange = Exchange(["can0", "a_name_of_15_ch"], 7_000, **getattr(request, "param", {}))
    memory = mmap.mmap(exchange.descriptor, 0)
    shared = Shared.from_buffer(memory)
    yield exchange, shared
    del shared
    exchange.close()


def some_frame(dice):
    is_extended, is_remote = dice.random() < 0.5, dice.random() < 0.2
    data = b"" if is_remote else dice.randbytes(dice.randrange(9))
    can_id = dice.getrandbits(29 if is_extended else 11)
    return Frame(can_id, data, is_remote, is_extended, bus=dice.randrange(16))


def same(record, frame):
    flags = EXTENDED * frame.is_extended | REMOTE * frame.is_remote
    length, data = len(frame.data), bytes(record.data)
    known = (record.id, record.length, record.bus, data)
    return known == (frame.can_id | flags, length, frame.bus, frame.data.ljust(8, b"\0"))


@pytest.mark.parametrize("both", [{}, {"is_real": True}], indirect=True)
def test_the_memory_begins_as_the_header_has_it(both, request):
    exchange, shared = both
    is_real = request.node.callspec.params["both"].get("is_real", False)
    assert (shared.version, shared.buses, shared.is_real) == (1, 2, is_real)
    assert (shared.now, shared.until, shared.grant) == (7_000, 7_000, 0)
    names = [bytes(name).partition(b"\0")[0] for name in shared.names]
    assert names == [b"can0", b"a_name_of_15_ch", *[b""] * 14]
    assert shared.random != 0
    assert (exchange.room, exchange.is_attached, exchange.wake) == (RING, False, 0)
    exchange.pass_time(8_000)
    assert (shared.now, shared.until) == (8_000, 7_000)
    shared.state, shared.wake, shared.refusal = 1, 9_000, b"no threads"
    assert (exchange.is_attached, exchange.wake, exchange.refusal) == (True, 9_000, "no threads")
    shared.state, shared.refusal = 2, b"x" * 172
    assert (exchange.is_attached, exchange.wake, exchange.refusal) == (False, 0, "x" * 172)


def test_frames_go_round_the_rings_whole_and_in_order(both):
    """Three rounds of either ring; the program takes and sends as it likes."""
    exchange, shared = both
    dice = random.Random(3)  # noqa: S311 - no secrets
    head, tail = 0, 0
    for number in range(1, 21):
        frames = [some_frame(dice) for _ in range(700)]
        exchange.grant(number * 10, [TimedFrame(number, each) for each in frames])
        assert (shared.grant, shared.until) == (number, number * 10)
        assert shared.in_head == head + 700
        for place, frame in enumerate(frames, head):
            record = shared.received[place % 4096]
            assert record.time == number
            assert same(record, frame)
        head += 700
        assert exchange.room == RING - 700
        shared.in_tail = head
        assert exchange.room == RING
        assert not exchange.is_lived
        shared.answered = number
        assert exchange.is_lived
        for place, frame in enumerate(frames, tail):
            record = shared.sent[place % 4096]
            record.time, record.length, record.bus = -number, len(frame.data), frame.bus
            record.id = frame.can_id | EXTENDED * frame.is_extended | REMOTE * frame.is_remote
            record.data[:] = frame.data.ljust(8, b"\xaa")
        tail += 700
        shared.out_head = tail
        assert exchange.take() == [TimedFrame(-number, frame) for frame in frames]
        assert (shared.out_tail, exchange.take()) == (tail, [])


def test_heads_and_grants_count_on_beyond_32_bits(both):
    exchange, shared = both
    last = (1 << 32) - 1
    exchange._in_head = exchange._out_tail = exchange._number = last
    shared.in_tail = shared.out_head = last
    exchange.grant(5, [TimedFrame(1, Frame(1)), TimedFrame(2, Frame(2))])
    assert (shared.in_head, shared.grant, exchange.room) == (1, 0, RING - 2)
    assert [shared.received[place].time for place in (4095, 0)] == [1, 2]
    shared.sent[4095].time, shared.sent[0].time, shared.out_head = 3, 4, 1
    assert [time for time, _ in exchange.take()] == [3, 4]
    assert shared.out_tail == 1


def test_an_identifier_of_11_bits_has_no_more(both):
    exchange, shared = both
    shared.sent[0].id, shared.sent[1].id, shared.out_head = 0x1FFF_FFFF, 0x9FFF_FFFF, 2
    assert [f.can_id for _, f in exchange.take()] == [0x7FF, 0x1FFF_FFFF]


@pytest.mark.parametrize(
    ("buses", "names"),
    [
        (["bus"], ["can0"]),
        (["left", "bus", "right"], ["left", "can1", "right"]),
        (["a" * 15, "a" * 16, "ä" * 8], ["a" * 15, "can1", "can2"]),
    ],
)
def test_an_interface_has_the_name_of_its_bus_where_a_kernel_takes_it(buses, names):
    assert program.interface_names(buses) == names


def test_patience_ends_with_processor_time_or_with_idle_seconds(monkeypatch):
    used, state, now = 0.0, "S", 100.0
    monkeypatch.setattr(patience.time, "clock_gettime", lambda clock: used + 0.0 * clock)
    monkeypatch.setattr(patience, "read_status", lambda pid: ProcessStatus(pid, state, 1, 1))
    monkeypatch.setattr(patience.time, "monotonic", lambda: now)
    used = 3.0
    lasting = patience.Patience(1, 2.0, 10.0)
    assert lasting.find_lapse() is None
    used, now = 5.0, 105.0  # exactly what it may take, since its first sight
    assert lasting.find_lapse() is None
    now = 115.0
    assert lasting.find_lapse() is None
    now = 115.1
    assert lasting.find_lapse() is patience.Lapse.IDLES
    state = "R"  # runs, though its clock has not moved yet
    assert lasting.find_lapse() is None
    used = 5.1
    assert lasting.find_lapse() is patience.Lapse.COMPUTES
    lasting = patience.Patience(1, 2.0, 10.0)
    used = -1.0
    assert lasting.find_lapse() is None


def library(frames=(), count=None, words=b""):
    """A controller without a library, whose last call has sent some frames."""
    made = object.__new__(LibraryController)
    made._path, made._instance, made._lines, made.has_begun = "lib.so", 1, [], True
    made._call = {"message": lambda _instance: words}
    packed = b"".join(_FRAME.pack(*each) for each in frames)
    made._sent = bytearray(packed.ljust(256 * 24, b"\0"))
    return made, len(frames) if count is None else count


# struct hil_frame: time, identifier, bus, length, flags (1: 29 bits, 2: remote), data
@pytest.mark.parametrize(
    ("frame", "expected"),
    [
        ((9, 0x7FF, 3, 8, 0, b"12345678"), Frame(0x7FF, b"12345678", bus=3)),
        ((0, 0, 0, 0, 0, b""), Frame(0)),
        ((1, 0x1FFF_FFFF, 0, 1, 1, b"ab"), Frame(0x1FFF_FFFF, b"a", is_extended=True)),
        ((1, 5, 0, 2, 2, b"ab"), Frame(5, is_remote=True)),
        ((1, 0x800, 0, 2, 3, b"ab"), Frame(0x800, is_remote=True, is_extended=True)),
        ((10, 1, 0, 0, 0, b""), None),
        ((1, 0x800, 0, 0, 0, b""), None),
        ((1, 0x2000_0000, 0, 0, 1, b""), None),
        ((1, 1, 0, 9, 0, b""), None),
        ((1, 1, 0, 0, 4, b""), None),
    ],
)
def test_a_frame_of_a_library_is_a_can_frame_or_refused(frame, expected):
    made, count = library([frame])
    if expected is not None:
        assert made._take(count, 9) == [TimedFrame(frame[0], expected)]
        return
    what = f"identifier 0x{frame[1]:X}, length {frame[3]}, flags {frame[4]}"
    with pytest.raises(ControllerError) as caught:
        made._take(count, 9)
    assert str(caught.value) == f"lib.so: sent no CAN frame: {what}, at {frame[0] * 1e-9:g} s"


def test_a_library_sends_no_more_frames_than_there_is_room_for():
    made, _ = library()
    assert len(made._take(256, 0)) == 256
    with pytest.raises(ControllerError, match="says that it sent 257 frames, and had room for 256"):
        made._take(257, 0)


@pytest.mark.parametrize(
    ("state", "words", "text"),
    [
        (State.FAILED, b"", "lib.so: has failed: it gives no reason"),
        (State.FAILED, b"one\ntwo\n", "lib.so: has failed: two"),
        (3, b"", "lib.so: has failed: answers 3"),
        (-2, b"", "lib.so: has failed: answers -2"),
        (State.ENDED, b"bye\n", "bye"),
        (State.ENDED, b"", ""),
    ],
)
def test_the_state_of_a_library_is_an_end_or_a_failure_in_its_words(state, words, text):
    made, _ = library(words=words)
    kind = ControllerEnd if state == State.ENDED else ControllerError
    with pytest.raises(kind) as caught:
        made._look_at(state, ["kept"])
    assert str(caught.value) == text
    assert state != State.ENDED or caught.value.sent == ["kept"]
    made._look_at(State.STARTING, [])
    assert made.has_begun is False
