"""Unmodified programs on the bench's clock.

What the kernel does for CAN sockets is said in its Documentation/networking/can.rst; times follow
from what `can_program.c` asks for, in microseconds.
"""

import contextlib
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
from support.dissection import require_tool
from support.programs import (
    TICK,
    build_can_program,
    build_program,
    live,
    needs_compiler,
    surroundings_of,
)
from support.tables import from_text

from hil_bench import ControllerEnd, TimedFrame, load_config
from hil_bench.abilities.controllers.program import controller as controller_module
from hil_bench.abilities.controllers.program.exchange import RING
from hil_bench.abilities.controllers.program.kind import KIND
from hil_bench.bench.session import open_session
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import ControllerError

pytestmark = needs_compiler
FOR_EVER = 10**9  # ticks
EPOCH = 1767225600  # 2026-01-01 00:00:00 UTC


@pytest.fixture(scope="module")
def can_program(tmp_path_factory):
    return build_can_program(tmp_path_factory.mktemp("program"))


@pytest.fixture
def start(can_program, tmp_path):
    """Start a part of `can_program`, or any command; all are closed at the end."""
    started = []

    def start(*command, buses=("bus",), **settings):
        words = command if len(command) > 1 else (can_program, *command)
        started.append(build_program(words, tmp_path / str(len(started)), *buses, **settings))
        (tmp_path / str(len(started) - 1)).mkdir()
        return started[-1]

    yield start
    for each in started:
        each.close()


def test_a_program_keeps_its_cycle_to_the_nanosecond(start):
    life = live(start("cycle"), 7)
    frames = [Frame(0x100, bytes([number])) for number in range(4)]
    assert life.sent == list(zip([1500, 3000, 4500, 6000], frames, strict=True))
    assert life.ending == "exit code 0"


def test_it_begins_when_the_bench_has_got_to(start):
    controller = start("cycle")
    sent = controller.advance(10 * TICK, ())
    assert [time for time, _ in sent] == []  # it began a tick before, at 9 ms
    assert [time for time, _ in controller.advance(11 * TICK, ())] == [10_500_000]


def test_frames_come_at_their_times_and_answers_leave_then(start):
    frames = {
        2100: [Frame(0x123, b"\1\2")],
        3900: [Frame(0x1ABCDEF0, b"", is_extended=True), Frame(0x7F0, is_remote=True)],
    }
    life = live(start("echo"), 6, frames)
    assert life.sent == [
        (2100, Frame(0x124, b"\1\2")),
        (3900, Frame(0x1ABCDEF1, b"", is_extended=True)),
        (3900, Frame(0x7F1, is_remote=True)),
    ]
    assert life.lines == [f"2100 read {0x123}", f"3900 read {0x1ABCDEF0}", f"3900 read {0x7F0}"]


def test_a_frame_at_its_very_start_finds_no_socket(start):
    assert live(start("echo"), 3, {0: [Frame(1)], 1: [Frame(2)]}).sent == [(1, Frame(3))]


def test_every_wait_ends_at_its_deadline(start):
    assert live(start("waits"), 1013).lines == [
        "5000 poll 0",
        "5250 ppoll 0",
        "7250 select 0",
        "7250 rest 0",
        "10250 epoll 0",
        "10350 usleep 0",
        "10600 nanosleep 0",
        "11600 read EAGAIN",  # SO_RCVTIMEO, 1 ms
        "11600 recv EAGAIN",
        "11600 read EAGAIN",
        "1011600 sleep 0",
    ]


def test_a_frame_ends_a_wait(start):
    lines = live(start("ready"), 4, {2000: [Frame(1)]}).lines
    assert lines == ["2000 poll 1", "2000 select 1", "2000 epoll 1"]


def test_a_timer_counts_bench_time(start):
    lines = live(start("timers"), 4).lines  # first after 1 ms, then every 0.5 ms
    assert lines == ["1000 times 1", "1500 times 1", "2100 times 1"]


def test_alarms_interrupt_a_pause(start):
    lines = live(start("alarms"), 8).lines  # SIGUSR1 at 2 ms; SIGALRM at 4 ms, then every 1 ms
    moments = [2000, 4000, 5000, 6000]
    expected = [(f"{at} pause EINTR", f"{at} signals {n}") for n, at in enumerate(moments, 1)]
    assert lines == [line for pair in expected for line in pair]


def test_waits_for_signals_count_bench_time(start):
    assert live(start("signals"), 9).lines == [
        "3000 sigtimedwait EAGAIN",
        "5000 sigsuspend EINTR",
        "5000 signals 1",
        "7000 ticks 0",  # of 10 ms
    ]


def test_messages_by_the_batch(start):
    frames = [Frame(0x100 + number) for number in range(3)]
    life = live(start("batches"), 4, {2000: frames})
    assert life.lines == [
        "0 waiting 0",
        "2000 received 3",
        "ids 100 101 102",
        "2000 waiting 0",
        "2000 sent 2",
        "2000 sent EINVAL",
    ]
    assert [frame.can_id for _, frame in life.sent] == [0x100, 0x101]


def test_filters_are_those_of_the_kernel(start):
    frames = [
        Frame(0x123),
        Frame(0x2A0),
        Frame(0x2A1),
        Frame(0x123, is_extended=True),
        Frame(0x123, is_remote=True),
    ]
    assert live(start("filters"), 6, {1000: frames}).lines == [
        "one: 123 80000123 40000123",  # no flag in the mask: any kind of frame
        "two: 123 2a0 2a1 80000123 40000123",
        "not: 2a0 2a1",
        "both: 2a1",
        "standard: 123",
        "extended: 80000123",
        "none:",
    ]


def test_messages_say_where_they_come_from_and_when(start):
    frames = {2000: [Frame(0x123), Frame(0x2A0, bus=1)]}
    life = live(start("messages", buses=("bus", "front")), 4, frames)
    assert life.lines == [
        "one: 123 on can0",
        f"other: 123 on can0 at {EPOCH}.002000",
        f"other: 2a0 on front at {EPOCH}.002000",
        "second: 2a0 on front",
        f"stamp {EPOCH}.002000",
        "2500 one EAGAIN",  # none of its own
        f"other: 10 on can0 local at {EPOCH}.002500",
        "2500 second EAGAIN",
        "one: 11 on can0 local own",
        f"other: 11 on can0 local at {EPOCH}.002500",
        "2500 one EAGAIN",  # CAN_RAW_LOOPBACK is off
        "2500 other EAGAIN",
    ]
    assert [frame.can_id for _, frame in life.sent] == [0x10, 0x11, 0x12]


def test_interfaces_have_the_names_of_the_buses(start):
    life = live(start("names", buses=("bus", "front")), 2)
    assert life.lines == [
        "0 same index 1",
        "0 mtu 16",
        "0 up 1",
        "name front",
        "0 bound 1",
        "0 domain 1",
        "0 can7 ENODEV",
        "0 bcm EPROTONOSUPPORT",
        "0 bind ENODEV",
        "hil-bench: CAN protocol 2 is not supported; CAN_RAW is",
    ]


def test_what_a_bus_cannot_take_is_refused_as_by_the_kernel(start):
    life = live(start("wrong"), 2)
    assert life.lines == [
        "0 short EINVAL",
        "0 unbound ENXIO",
        "0 nine bytes EINVAL",
        "0 fd option 0",
        "0 fd frame EINVAL",  # no interface of CAN FD
        "0 option ENOPROTOOPT",
        "0 connect EOPNOTSUPP",
    ]
    assert life.sent == []


def test_a_copied_descriptor_is_the_same_socket(start):
    life = live(start("copies"), 2)
    assert [frame.can_id for _, frame in life.sent] == [1, 2]
    assert life.lines == ["0 closed EBADF"]


def test_a_program_that_spins_on_the_clock_gets_on(start):
    assert live(start("spin"), 5).sent == [(3000, Frame(0x40, b"\0"))]


def test_more_frames_at_once_than_the_memory_holds(start):
    life = live(start("flood"), 3)
    assert len(life.sent) == 9000 > 2 * RING
    assert [frame.data[0] for _, frame in life.sent] == [n % 256 for n in range(9000)]


def test_more_frames_received_at_once_than_the_memory_holds(start):
    frames = [Frame(0x600 + number % 16) for number in range(RING + 10)]
    life = live(start("echo"), 2, {1: frames})
    assert 0 < len(life.sent) <= len(frames)  # a socket holds no more than the kernel's
    assert life.sent[0] == (1, Frame(0x601))


def test_children_live_one_after_the_other(start):
    life = live(start("children"), 6)
    assert life.sent == [(2000, Frame(0x20, b"\0")), (4000, Frame(0x20, b"\1"))]
    assert life.lines == ["4000 time 4000"]


def test_no_time_passes_for_a_process_whose_child_lives(start):
    """But the child's own, however long the machine takes to start it."""
    assert live(start("pipes"), 6).lines == ["3000 poll 1", "4000 time 4000"]


@from_text("part", "line")
def test_what_cannot_go_on_is_said_in_one_line(start, part, line):
    with pytest.raises(ControllerError, match=line) as caught:
        live(start(part), 100_000)  # until the machine has run both of two processes
    assert len(str(caught.value).splitlines()) == 1


@pytest.fixture
def watchful(monkeypatch):
    """A bench that looks at a silent program often."""
    monkeypatch.setattr(controller_module, "_GLANCE_MS", 10)


@pytest.fixture
def unhurried(monkeypatch):
    """A bench that is never ahead of the clock: these tests look at none."""
    monkeypatch.setattr(controller_module, "LEAD_NS", 1 << 62)


@pytest.mark.usefixtures("unhurried")
def test_in_real_time_a_program_may_have_threads(start, can_program):
    controller = start("threads", time="real")
    now, sent = 0, []
    while not sent:  # it opens its socket some time
        now += TICK
        sent = controller.advance(now, [TimedFrame(now - TICK, Frame(0x200, b"\5"))])
    assert sent[0] == TimedFrame(now, Frame(0x201, b"\5"))
    controller.close()
    assert not _children(can_program)


@pytest.mark.usefixtures("unhurried")
def test_in_real_time_a_program_ends_by_itself(start):
    life = live(start("flood", time="real"), FOR_EVER)
    assert life.ending == "exit code 0"
    data = [frame.data[0] for _, frame in life.sent]
    assert data[:RING] == [number % 256 for number in range(RING)]  # then ENOBUFS may come
    with pytest.raises(ControllerError, match=r"has ended, exit code 7$"):
        live(start("exits", time="real"), FOR_EVER)


def test_real_time_needs_a_bench_that_keeps_to_the_clock(start):
    controller = start("terminated", time="real")
    controller.advance(TICK, ())
    with pytest.raises(
        ControllerError, match=r'^time = "real" needs a bench that keeps to the mach'
    ):
        controller.advance(10_000 * TICK, ())  # 10 s after its start


@pytest.mark.usefixtures("watchful")
def test_a_program_that_never_waits_is_ended(start, can_program):
    controller = start("forever", cpu_s=0.1)
    with pytest.raises(
        ControllerError, match=r"^at 0\.00. s it took 0\.1 s of processor time and did not wait"
    ):
        live(controller, 2)
    controller.close()
    assert not _children(can_program)


@pytest.mark.usefixtures("watchful")
def test_a_program_that_waits_for_something_else_is_ended(start, monkeypatch, tmp_path):
    monkeypatch.setattr(controller_module, "PATIENCE", 0.0)
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)  # whose other end nobody opens
    with pytest.raises(
        ControllerError, match=r"^at 0\.00. s for 0 s it has neither worked nor waited"
    ):
        live(start("sh", "-c", f"read line < {pipe}"), 2)


def test_no_child_outlives_it(start, can_program):
    controller = start("orphan")
    assert live(controller, 3).ending == "exit code 0"
    controller.close()
    assert not _children(can_program)


def _children(program):
    """The command lines of this program's living processes; the dead have none."""
    lines = []
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):  # it has just gone
            lines.append(file.read_bytes().decode(errors="replace"))
    return [line for line in lines if line.startswith(f"{program}\0")]


def test_close_lets_it_leave_in_order(start):
    controller = start("terminated")
    live(controller, 50)
    controller.close()
    controller.close()
    assert controller.tail().splitlines() == ["50000 sleep EINTR", "50000 signals 1", "left"]


def test_reset_begins_anew(start):
    controller = start("cycle")
    controller.advance(2 * TICK, ())
    controller.reset()
    assert controller.advance(3 * TICK, ()) == []
    sent = controller.advance(4 * TICK, ())
    assert sent == [TimedFrame(3_500_000, Frame(0x100, b"\0"))]  # 1.5 ms after 2 ms


def test_nothing_is_left_open(start):
    before = sorted(Path("/proc/self/fd").iterdir())
    controller = start("echo")
    controller.advance(TICK, ())
    controller.close()
    assert sorted(Path("/proc/self/fd").iterdir()) == before


def test_scripts_and_their_tools(start, make_file):
    require_tool("cansend", "can-utils")
    script = make_file(
        "script",
        "#!/bin/sh\nsleep 0.01\ncansend {bus} 123#1122\ncandump -ta -n 1 $1 | cat\n".replace(
            "{bus}", "can0"
        ),
    )
    script.chmod(0o755)
    life = live(start(script, "{bus}"), 30, {20_000: [Frame(0x181, b"\7")]})
    assert life.sent == [(10_000, Frame(0x123, b"\x11\x22"))]
    assert life.lines == [f" ({EPOCH}.020000)  can0  181   [1]  07"]


def test_ip_knows_the_interfaces_of_the_bench_alone(start):
    require_tool("ip", "iproute2")
    commands = [
        "ip link set front up type can bitrate 500000",  # of a script that sets an adapter up
        "ip -json link show front",
        "ip -json link show type vcan | tr , '\\n' | grep ifname",
        "ip link show lo || true",
    ]
    lines = live(start("sh", "-c", "; ".join(commands), buses=("bus", "front")), 3).lines
    [about] = json.loads(lines[0])
    assert {"ifname": "front", "mtu": 16, "operstate": "UP", "link_type": "can"}.items() <= (
        about.items()
    )
    assert "UP" in about["flags"]
    assert lines[1:3] == ['"ifname":"can0"', '"ifname":"front"']
    assert "No such device" in lines[3]


PYTHON = """
import time, can
bus = can.Bus(interface="socketcan", channel="can0")
bus.send(can.Message(arbitration_id=0x181, data=[1], is_extended_id=False))
message = bus.recv(1.0)
print(message.arbitration_id, message.timestamp, round(time.monotonic() % 1, 6))
print(bus.recv(0.004), round(time.monotonic() % 1, 6))
time.sleep(0.25)
bus.send(can.Message(arbitration_id=0x182, is_extended_id=False))
bus.shutdown()
"""


@pytest.mark.long  # an interpreter that imports python-can
def test_python_can_on_socketcan(start):
    life = live(start(sys.executable, "-c", PYTHON), 300, {8000: [Frame(0x7FF)]})
    assert life.lines == [f"2047 {EPOCH}.008 0.008", "None 0.012"]
    assert life.sent == [(0, Frame(0x181, b"\1")), (262_000, Frame(0x182))]


@pytest.mark.long  # builds the example, and runs it for a second of bench time, twice
def test_the_example_in_c_moves_the_axis_and_twice_alike(tmp_path):
    example = Path(__file__).parents[3] / "examples" / "firmware"
    subprocess.run(["make", "-s", "-C", example, f"BUILD={tmp_path}"], check=True)  # noqa: S607
    command = (str(tmp_path / "position_control"), "--bus", "{bus}", "--targets-mm", "40")
    first, second = (_move(command, tmp_path / name) for name in ("one", "other"))
    assert first == second
    assert first.position == pytest.approx(0.040, abs=1e-4)  # what the example calls settled
    assert "0 overruns" in first.tail


class Moved(NamedTuple):
    """The frames of both sides, the position at the end [m], and what the program printed."""

    frames: list
    position: float
    tail: str


def _move(command, scratch):
    """Run a program against the built-in bench, to the end of the program."""
    scratch.mkdir()
    config = load_config()
    session = open_session(config)
    session.start()
    session.tick((), 0)
    surroundings = surroundings_of(scratch)._replace(tick_ns=config.tick_ns)
    settings = {"command": command, "time": "bench", "cpu_s_per_tick": 5.0}
    controller = KIND.build(settings, surroundings)
    frames, out, now = [], (), 0
    try:
        while now < 5e9:
            sent = controller.advance(now + TICK, [TimedFrame(now, frame) for frame in out])
            now += TICK
            out = session.tick([frame for _, frame in sent], now)
            frames += [*sent, *((now, frame) for frame in out)]
    except ControllerEnd:
        pass
    finally:
        controller.close()
    position = dict(zip(session.channels, session.row()[1:], strict=True))
    [place] = [each for each in position if each.name == "axis1.position"]
    return Moved(frames, position[place], controller.tail())
