"""`hil-bench watch` on a bus: frames are given and time is counted, nothing waits."""

import math
import signal
import struct

import can
import pytest
from rich.console import Console

from hil_bench.abilities.eyes.bus_state import EXTENDED, BusState
from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.listener import Listener
from hil_bench.abilities.eyes.verbs import listening, watch_bus
from hil_bench.abilities.eyes.verbs.watch_bus import BusView
from hil_bench.abilities.recording.frames import message_of
from hil_bench.canopen_device.frame import Frame
from hil_bench.cli import main
from hil_bench.frame import ERROR_FLAG, frame_bits
from hil_bench.outside.recording.channels import LoggedFrame

BENCH = """\
[nodes]
valve = { profile = "valve_408", node_id = 1 }
pressure_a = { profile = "pressure_404", node_id = 2, source = "P_A" }
"""
MS = 1_000_000
OPERATIONAL = b"\x05"  # CiA 301, 7.2.8.3.2.2
LIFE_GUARD = bytes.fromhex("3081 11 0000000000")  # 0x8130, communication and generic error


def pressure(bar):
    return Frame(0x182, struct.pack("<fB", bar, 0))  # TPDO1 of the EDS: REAL32 and a status


def emcy(code, register):
    return Frame(0x081, struct.pack("<HB5x", code, register))


class TimedBus:
    """A python-can bus whose frames come at their times, and the clock that it moves on.

    Args:
        frames: with their times [s].
        end: time at which it ends [s].
        last: called at the end; Ctrl-C by default.
    """

    def __init__(self, frames, end, last=lambda: signal.raise_signal(signal.SIGINT)):
        self.time = 0.0
        self._frames = [*frames]
        self._end = end
        self._last = last

    def clock(self):
        return self.time

    def recv(self, timeout):
        if self._frames and self._frames[0][0] <= self.time + timeout:
            self.time, frame = self._frames.pop(0)
            message = message_of(LoggedFrame(frame, 0, None))
            message.timestamp = 1.7e9 + self.time  # as a driver has it: the date
            return message
        self.time += timeout
        if self.time >= self._end and self._last is not None:
            last, self._last = self._last, None
            last()
        return None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass


@pytest.fixture
def watched(tmp_path, monkeypatch, capsys):
    """Return what watches frames by the command line: exit code, picture and messages."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bench.toml").write_text(BENCH)
    monkeypatch.setenv("COLUMNS", "150")
    monkeypatch.setenv("TERM", "xterm")

    def watch(frames, *words, bus=None):
        bus = bus or TimedBus(frames, math.inf)
        monkeypatch.setattr(listening, "open_can_bus", lambda *_: (bus, "can0"))
        monkeypatch.setattr(watch_bus, "monotonic", bus.clock)
        if "--once" not in words:
            monkeypatch.setenv("FORCE_COLOR", "1")  # for rich, a terminal
        code = main(["watch", "-i", "socketcan", "-c", "can0", *words])
        shown = capsys.readouterr()
        return code, [" ".join(line.split()) for line in shown.out.splitlines()], shown.err

    return watch


def state_of(*frames, step=100 * MS):
    """Return the state after frames, the first one at 0, one each `step`."""
    state = BusState(Decoder(), 1_000_000)
    for number, frame in enumerate(frames):
        state.take(LoggedFrame(frame, number * step, None))
    return state


def drawn(state):
    console = Console(width=150, markup=False, emoji=False, highlight=False)
    view = BusView(1_000_000, Listener(None, "can0"), state)
    with console.capture() as capture:
        console.print(view.render())
    return [" ".join(line.split()) for line in capture.get().splitlines()]


def test_one_picture_has_nodes_values_errors_and_who_sends_how_often(watched):
    frames = [
        (0.1, Frame(0x701, OPERATIONAL)),
        (0.2, pressure(50.0)),
        (0.3, pressure(70.0)),
        (0.4, emcy(0x8130, 0x11)),
        (0.5, pressure(60.0)),
        (0.6, Frame(0x201, bytes.fromhex("07000010"))),  # 0x1000 of 0x4000 is 25 %
    ]
    code, lines, _ = watched(frames, "bench.toml", "--once")
    assert code == 0
    assert lines[0].startswith("bus can0, 6 frames, load ")
    assert lines[0].endswith(" % of 1 Mbit/s no frame for 1.4 s")  # the picture is of 2 s
    assert "valve 1 OPERATIONAL 0x8130 life guard or heartbeat error" in lines
    assert "pressure_a 2 not known" in lines
    (event,) = [line for line in lines if line.startswith("event")]
    assert event.startswith("event 0.300 s: valve: EMCY 0x8130, life guard or heartbeat error,")
    # 60 bar are half way from 50 bar to 70 bar, so half of a bar of 8.
    (value,) = [line for line in lines if "AI input process value 1" in line]
    assert value == "pressure_a TPDO1 AI input process value 1 60 bar 50 ████ 70"
    (spool,) = [line for line in lines if "Spool set-point" in line]
    assert spool.startswith("valve RPDO1 Spool set-point 25 % 25 ")
    assert "valve RPDO1 Device control word 0x0007 DHM" in lines  # a word has no range
    # Intervals of 100 ms and 200 ms; the last one is 1.5 s before the end.
    assert "182 pressure_a TPDO1 5 3 150.0 ms 1.5 s ago" in lines
    assert "701 valve heartbeat 1 1 - 1.9 s ago" in lines


def test_a_node_that_nobody_has_named_is_seen(watched):
    _, lines, _ = watched([(0.1, Frame(0x70B, b"\x7f"))], "--once")
    assert "node 11 11 PRE-OPERATIONAL" in lines


def test_a_known_node_that_is_not_there_is_told(watched):
    _, lines, _ = watched([(0.1, Frame(0x701, OPERATIONAL))], "bench.toml", "--once")
    assert "pressure_a 2 not heard" in lines


def test_a_silent_bus_is_told_from_a_good_one(watched):
    code, lines, _ = watched([], "--once")
    assert code == 6
    assert lines == ["bus can0, 0 frames, load 0.0 % of 1 Mbit/s no frame yet, after 2.0 s"]


def test_reports_of_errors_are_no_frames(watched):
    """As at a wrong bit rate: nothing of the bus was seen."""
    code, lines, _ = watched([(0.5, Frame(ERROR_FLAG | 4, bytes(8)))], "--once")
    assert code == 6
    assert lines[0].startswith("bus can0, 0 frames, load ")
    assert lines[0].endswith(", 1 error frames no frame yet, after 1.5 s")


def test_a_state_that_was_commanded_is_told_from_one_that_a_node_reports(watched):
    """The valve is started and sends its state; the transducer has no heartbeat."""
    start = Frame(0x000, b"\1\0")
    frames = [(0.1, pressure(50.0)), (0.2, Frame(0x701, b"\x7f")), (0.3, start)]
    _, lines, _ = watched(frames, "bench.toml", "--once")
    assert {"valve 1 OPERATIONAL, commanded", "pressure_a 2 OPERATIONAL, commanded"} <= {*lines}
    _, lines, _ = watched([*frames, (0.4, Frame(0x701, OPERATIONAL))], "bench.toml", "--once")
    assert {"valve 1 OPERATIONAL", "pressure_a 2 OPERATIONAL, commanded"} <= {*lines}


def test_a_lost_bus_is_one_line(watched):
    def lose():
        raise can.CanOperationError("Network is down")

    bus = TimedBus([(0.1, Frame(0x701, OPERATIONAL))], 0.5, lose)
    code, _, errors = watched([], bus=bus)
    assert code == 3
    assert errors.splitlines() == ["hil-bench: error: can0: bus lost: Network is down"]


@pytest.mark.parametrize("kind", ["file", "dumb terminal"])
def test_what_cannot_be_drawn_anew_is_refused(kind, monkeypatch, capsys):
    """Both showed nothing until Ctrl-C."""
    if kind == "dumb terminal":
        monkeypatch.setenv("FORCE_COLOR", "1")
        monkeypatch.setenv("TERM", "dumb")
    assert main(["watch", "-i", "virtual", "-c", "x"]) == 2
    assert "watch draws on a terminal, which this is not; --once" in capsys.readouterr().err


def test_ctrl_c_ends_it(watched):
    bus = TimedBus([(0.1, Frame(0x701, OPERATIONAL))], 0.5)
    assert watched([], bus=bus)[0] == 0
    assert bus.time < 0.7


def test_a_bus_and_a_bench_that_runs_are_not_one(watched):
    code, _, errors = watched([], "--bench", "left")
    assert code == 2
    assert "--bench left: is a bench that runs here; a bench.toml, -i, -c," in errors


def test_a_picture_comes_ten_times_a_second_however_many_frames_come():
    bus = TimedBus([(0.001 * number, Frame(0x080)) for number in range(1, 1001)], math.inf)
    state = BusState(Decoder(), 1_000_000)
    pictures = watch_bus.hear(Listener(bus, "can0"), state, bus.clock)
    times = [next(pictures) for _ in range(10)]
    assert times == pytest.approx([0.1 * number for number in range(1, 11)], abs=2e-3)
    # A thousand frames a second without data; the window may miss one.
    assert state.load == pytest.approx(1000 * frame_bits(0) / 1e6, rel=0.02)


def test_the_load_falls_when_nothing_comes():
    state = state_of(*[Frame(0x080)] * 20)
    assert state.load > 0.0
    for silence in range(1, 21):
        state.wait(silence * 100 * MS)
    assert state.load == 0.0
    assert state.silence == 2.0


def test_a_heartbeat_that_stays_out_is_told():
    state = state_of(*[Frame(0x705, OPERATIONAL)] * 6)
    assert "node 5 5 OPERATIONAL every 100 ms" in drawn(state)
    state.wait(200 * MS)
    assert state.heartbeat_missing(5) == 0.0
    state.wait(300 * MS)
    assert "node 5 5 OPERATIONAL every 100 ms, none for 0.3 s" in drawn(state)


def test_a_device_that_is_only_asked_is_no_node():
    state = state_of(Frame(0x605, b"\x40".ljust(8, b"\0")), Frame(0x706, b"", is_remote=True))
    assert state.nodes == []
    assert [stream.name for stream in state.streams.values()] == ["SDO request", "heartbeat"]


@pytest.mark.parametrize(
    ("frames", "codes"),
    [
        ([emcy(0x8130, 0x11), emcy(0x3100, 0x15)], {0x8130, 0x3100}),
        ([emcy(0x8130, 0x11), emcy(0x3100, 0x15), emcy(0, 0x11)], {0x8130, 0x3100}),
        ([emcy(0x8130, 0x11), emcy(0, 0)], set()),
        ([emcy(0x8130, 0x11), Frame(0x701, b"\0")], set()),
        ([Frame(0x081, LIFE_GUARD)], {0x8130}),
        ([Frame(0x081, LIFE_GUARD[:7]), Frame(0x081, b"", is_remote=True)], set()),
    ],
)
def test_errors_stay_until_the_node_says_that_all_have_gone(frames, codes):
    assert set(state_of(*frames).errors.get(1, {})) == codes


def test_a_request_without_an_answer_becomes_an_event():
    state = state_of(Frame(0x605, b"\x40\x00\x10".ljust(8, b"\0")))
    state.wait(2_000 * MS)
    assert [sight.problem for sight in state.events] == ["not answered"]


def test_a_frame_of_a_wrong_length_is_told_beside_its_identifier(watched):
    frames = [(0.1, Frame(0x182, b"\0" * 4)), (0.1, Frame(0x701, b"\5\0"))]
    _, lines, _ = watched(frames, "bench.toml", "--once")
    assert "701 valve heartbeat 2 1 - 1.9 s ago ! 2 bytes, 1 is right" in lines
    assert "182 pressure_a TPDO1 4 1 - 1.9 s ago ! 4 bytes, and its mapping has 5" in lines


def test_a_command_to_one_node_belongs_to_no_node():
    state = state_of(Frame(0x000, b"\x01\x05"))
    assert "000 NMT 2 1 - 0.0 s ago" in drawn(state)
    assert "event 0.000 s: node 5: NMT start, node 5" in drawn(state)


def test_an_event_that_comes_again_takes_no_second_line():
    start_all = Frame(0x000, b"\x01\x00")
    state = state_of(start_all, Frame(0x705, b"\0"), start_all)
    lines = [line for line in drawn(state) if line.startswith("event")]
    assert lines == [
        "event 0.100 s: node 5: boot-up",
        "event 0.200 s: all nodes: NMT start, all nodes",
    ]


def test_a_bus_without_a_frame_has_no_load():
    state = state_of()
    assert (state.load, state.frames) == (0.0, 0)
    assert "0 frames, load 0.0 % of 1 Mbit/s" in drawn(state)[0]


def test_a_mapping_that_changes_leaves_no_old_values():
    state = BusState(Decoder(), 1_000_000)

    def write(index, subindex, value, size):
        command = 0x23 | (4 - size) << 2
        place = struct.pack("<BHB", command, index, subindex)
        for frame in (
            Frame(0x605, place + value.to_bytes(4, "little")),
            Frame(0x585, b"\x60" + place[1:] + bytes(4)),
        ):
            state.take(LoggedFrame(frame, state.now + MS, None))

    write(0x1800, 1, 0x185, 4)
    for entry in (0x20000110, 0x20010110):  # 16 bits of 0x2000.01, then of 0x2001.01
        write(0x1A00, 1, entry, 4)
        write(0x1A00, 0, 1, 1)
        state.take(LoggedFrame(Frame(0x185, b"\x01\x02"), state.now + MS, None))
    assert list(state.values[0x185]) == [(0x2001, 1)]


def test_hostile_traffic_needs_no_more_memory():
    state = BusState(Decoder(), 1_000_000)
    for number in range(3000):
        frames = (
            Frame(number << 4, b"", is_extended=True),
            Frame(0x081, struct.pack("<HB5x", 0x1000 + number, 1)),
        )
        for frame in frames:
            state.take(LoggedFrame(frame, number * MS, None))
    assert state.streams.keys() == {EXTENDED, 0x081}
    assert state.streams[EXTENDED].count == 3000
    assert len(state.errors[1]) == 8
    assert len(list(state.events)) == 6
    assert "29-bit not CANopen 0 3000 1.0 ms 0.0 s ago" in drawn(state)


def test_texts_from_devices_stay_texts():
    begin = Frame(0x605, b"\x40\x08\x10".ljust(8, b"\0"))
    sized = Frame(0x585, b"\x41\x08\x10\x00" + struct.pack("<I", 7))
    more = Frame(0x605, b"\x60".ljust(8, b"\0"))
    last = Frame(0x585, b"\x01[red]:x")
    assert any('node 5 "[red]:x"' in line for line in drawn(state_of(begin, sized, more, last)))
