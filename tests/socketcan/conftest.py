"""What the tests on a real SocketCAN bus share: the bus, a watcher of its frames, the bench.

Every program here is a process of its own and meets the others on the bus only. The tests wait for
frames, and judge times by the stamps that the kernel gave them.
"""

import contextlib
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import NamedTuple

import can
import pytest
from support.can_link import set_link
from support.patience import GUARD

HOW_TO_GET_VCAN = (
    "no SocketCAN interface vcan0; run: python tests/socketcan/with_vcan.py pytest tests/socketcan"
)
PROGRAMS = Path(sys.executable).parent
NODE_IDS = (1, 2, 3, 4)  # of the built-in bench: valve, two pressure transducers, position sensor
RECEIVE_BUFFER = 8 * 1024 * 1024  # [byte]; the kernel's default loses frames of a flood
SO_RCVBUFFORCE = 33  # asm-generic/socket.h: SO_RCVBUF beyond what an unprivileged process may ask


@pytest.fixture(scope="session", autouse=True)
def channel():
    """The name of the interface under test; without it everything here is skipped."""
    try:
        with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as can_socket:
            can_socket.bind(("vcan0",))
    except (AttributeError, OSError):
        pytest.skip(HOW_TO_GET_VCAN)
    return "vcan0"


@pytest.fixture
def own_channel():
    """An interface of this test's own, which it may set down."""
    name = "vcan_lost"
    added = subprocess.run(["ip", "link", "add", name, "type", "vcan"], check=False)
    if added.returncode:
        pytest.skip("no right to add an interface; tests/socketcan/with_vcan.py gives it")
    set_link(name, "up")
    yield name
    subprocess.run(["ip", "link", "del", name], check=True)


class BusWatch:
    """The frames of the bus in order, read as far as somebody has waited.

    Attributes:
        frames: all that was read.
    """

    def __init__(self, bus):
        self.frames = []
        self._bus = bus

    def listen_to(self, *can_ids):
        """See these identifiers only, from now on."""
        self._bus.set_filters(
            [{"can_id": can_id, "can_mask": 0x7FF, "extended": False} for can_id in can_ids]
        )

    def wait_for(self, can_id, matches=lambda _: True, *, timeout=GUARD):
        """Return the next frame with this identifier and matching data."""
        for message in self._read(timeout):
            if message.arbitration_id == can_id and matches(message.data):
                return message
        raise AssertionError(f"no such frame 0x{can_id:03X} within {timeout:g} s")

    def wait_for_all(self, can_ids, *, timeout):
        """Wait until each of these identifiers was seen, in any order."""
        missing = set(can_ids)
        for message in self._read(timeout):
            missing.discard(message.arbitration_id)
            if not missing:
                return
        raise AssertionError(f"no frames {[f'0x{i:03X}' for i in missing]} within {timeout:g} s")

    def take_all(self):
        """Return what has arrived and was not read yet."""
        return list(iter(lambda: self._receive(0), None))

    def last(self, can_id, matches=lambda _: True):
        """Return the last frame read with this identifier and matching data."""
        return next(
            message
            for message in reversed(self.frames)
            if message.arbitration_id == can_id and matches(message.data)
        )

    def _read(self, timeout):
        deadline = time.monotonic() + timeout
        while (remaining := deadline - time.monotonic()) > 0:
            if message := self._receive(remaining):
                yield message

    def _receive(self, timeout):
        message = self._bus.recv(timeout)
        if message:
            self.frames.append(message)
        return message


@pytest.fixture
def watch(channel):
    """A watcher that sees every frame from the start of the test."""
    with can.Bus(interface="socketcan", channel=channel) as bus:
        with contextlib.suppress(PermissionError):
            bus.socket.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, RECEIVE_BUFFER)
        yield BusWatch(bus)


class Ended(NamedTuple):
    """What a program left behind."""

    exit_code: int
    stdout: str
    stderr: str


class Stream:
    """What a program writes to one of its streams, taken as it comes: no full pipe can stop it."""

    def __init__(self, pipe):
        self._text = ""
        self._is_open = True
        self._change = threading.Condition()
        self._reader = threading.Thread(target=self._read, args=(pipe,), daemon=True)
        self._reader.start()

    def text(self):
        """Return what has come so far."""
        with self._change:
            return self._text

    def wait_for(self, text, timeout):
        """Wait until this has come."""
        with self._change:
            self._change.wait_for(lambda: text in self._text or not self._is_open, timeout)
            assert text in self._text, f"no {text!r} in {self._text!r}"

    def wait_for_end(self, timeout):
        """Return all of it, once whoever may write to it has ended."""
        self._reader.join(timeout)
        assert not self._reader.is_alive(), f"still open after {timeout:g} s: {self.text()!r}"
        return self._text

    def _read(self, pipe):
        with pipe:
            for line in pipe:
                with self._change:
                    self._text += line
                    self._change.notify_all()
        with self._change:
            self._is_open = False
            self._change.notify_all()


class Program:
    """A process whose output is taken as it comes."""

    def __init__(self, command, directory):
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            cwd=directory,
            text=True,
        )
        self._stdout, self._stderr = Stream(self.process.stdout), Stream(self.process.stderr)

    def output(self):
        """Return what the program has printed so far."""
        return self._stdout.text()

    def wait_for_output(self, text, timeout=GUARD):
        """Wait until the program has written this to its standard output."""
        self._stdout.wait_for(text, timeout)

    def wait_for_error(self, text, timeout=GUARD):
        """Wait until the program has written this to its standard error."""
        self._stderr.wait_for(text, timeout)

    def wait(self, timeout=GUARD):
        """Return what the program left behind once it and all that it has started have ended."""
        exit_code = self.process.wait(timeout)
        return Ended(exit_code, *(s.wait_for_end(timeout) for s in (self._stdout, self._stderr)))

    def stop(self, signal_number=signal.SIGINT, timeout=GUARD):
        """Return what the program left behind after a signal."""
        self.process.send_signal(signal_number)
        return self.wait(timeout)

    def kill(self):
        """End the program without giving it a chance to say anything."""
        self.process.kill()
        self.process.wait()


@pytest.fixture
def cansend(channel):
    """Send a frame in the notation of can-utils, ``123#1122``."""
    return lambda frame: subprocess.run(["cansend", channel, frame], check=True)


@pytest.fixture
def start(tmp_path_factory):
    """Start a program of this environment; what is still running after the test is killed."""
    with contextlib.ExitStack() as stack:

        def start_program(name, *arguments):
            executable = PROGRAMS / name
            command = [str(executable if executable.exists() else name), *map(str, arguments)]
            program = Program(command, tmp_path_factory.mktemp(Path(name).stem))
            stack.callback(program.kill)
            return program

        yield start_program


@pytest.fixture
def start_bench(start, watch, channel):
    """Start ``hil-bench run`` on the bus and wait until each of its nodes has booted up."""

    def start_and_wait(*arguments):
        bench = start("hil-bench", "run", "-i", "socketcan", "-c", channel, *arguments)
        try:
            watch.wait_for_all([0x700 + node_id for node_id in NODE_IDS], timeout=GUARD)
        except AssertionError:
            bench.kill()
            pytest.fail(f"the bench did not boot up: {bench.wait()}")
        return bench

    return start_and_wait
