"""A recording that another process writes, so that the loop never waits for a disk.

The loop's side costs one copy into shared memory a tick. A recorder that is killed leaves files
that end with the last block; a loop that is killed leaves the recorder to write all it has left.
"""

import contextlib
import logging
import multiprocessing
import os
import signal
import struct
from collections.abc import Sequence
from multiprocessing.connection import Connection
from types import FrameType
from typing import Self

from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import ConfigError
from hil_bench.recording.logged_frame import LoggedFrame
from hil_bench.recording.recorder import (
    BLOCK_PERIOD,
    Recorder,
    RecordingPlan,
    RecordingReport,
    warn,
)
from hil_bench.recording.shared_ring import SharedRing
from hil_bench.spawning import start_shielded

CAPACITY = 8 << 20
"""Bytes between loop and recorder: several seconds of a 1 kHz bench of one axis."""

_ROW, _FRAMES = 1, 2
_FRAME = struct.Struct("<qIBB8s")  # time [ns], identifier, flags, length, data
_EXTENDED, _REMOTE, _RECEIVED = 1, 2, 4
_BUS_SHIFT = 3  # the flags above are the number of the bus
_NICENESS = 5  # the loop comes first where both want the same core
_START_TIMEOUT = 30.0
_END_TIMEOUT = 30.0


class RecorderProcess:
    """A recorder in a process of its own, as a context manager; `__enter__` starts it.

    Args:
        plan: what to record.

    Attributes:
        plan: as passed in.
        report: what the recording holds, once it has ended.
    """

    def __init__(self, plan: RecordingPlan) -> None:
        plan.check()
        self.plan = plan
        self.report = RecordingReport(is_triggered=not plan.trigger)
        self._ring = SharedRing(CAPACITY)
        self._row = struct.Struct(f"<{1 + len(plan.channels)}d")
        context = multiprocessing.get_context("spawn")
        # No lock and no event: what a killed process holds or waits for, others wait for in vain.
        self._connection, self._child_connection = context.Pipe()
        self._process = context.Process(
            target=record,
            args=(plan, self._ring, self._child_connection),
            name="hil-bench-recorder",
            daemon=True,
        )

    @property
    def pid(self) -> int:
        """Identifier of the process.

        Raises:
            ValueError: it has not started.
        """
        if self._process.pid is None:
            raise ValueError("the recorder has no process yet: start() it")
        return self._process.pid

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self) -> None:
        """Start the process and wait until its files are open.

        Raises:
            ConfigError: a file cannot be written.
        """
        start_shielded(self._process)
        self._child_connection.close()
        answer = self._receive(_START_TIMEOUT)
        if isinstance(answer, str):
            self._process.join()
            raise ConfigError(answer)

    def stop(self) -> None:
        """Have the process write what it has, and take its report."""
        with contextlib.suppress(OSError):  # it may have ended already
            self._connection.send(None)
        answer = self._receive(_END_TIMEOUT)
        if isinstance(answer, RecordingReport):
            self.report = answer
        else:
            name = ", ".join(map(str, self.plan.paths))
            self.report.problems.append(
                f"{name}: recording ended early: its process was ended from outside; what was "
                "written before is readable"
            )
        self.report.lost = self._ring.lost
        self._process.join(_END_TIMEOUT)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._connection.close()

    def append_row(self, values: Sequence[float]) -> None:
        """Record a row: time [s], then a value a channel in its SI unit."""
        self._ring.put(_ROW, self._row.pack(*values))

    def append_frames(self, frames: Sequence[Frame], now: int, *, is_received: bool) -> None:
        """Record frames.

        Args:
            frames: the frames.
            now: their time on the recording's time base [ns].
            is_received: whether we received them; we sent them otherwise.
        """
        if frames:
            direction = _RECEIVED if is_received else 0
            self._ring.put(
                _FRAMES,
                b"".join(
                    _FRAME.pack(
                        now,
                        can_id,
                        is_extended + (is_remote << 1) + direction + (bus << _BUS_SHIFT),
                        len(data),
                        data,
                    )
                    for can_id, data, is_remote, is_extended, bus in frames
                ),
            )

    def _receive(self, timeout: float) -> str | RecordingReport | None:
        """Return what the process says; None where it has ended or says nothing in time."""
        try:
            if self._connection.poll(timeout):
                answer: str | RecordingReport | None = self._connection.recv()
                return answer
        except (EOFError, OSError):
            return None
        return None


def record(plan: RecordingPlan, ring: SharedRing, connection: Connection) -> None:
    """Write what comes through the ring until told to end, or until the loop's process is gone.

    Args:
        plan: what to record.
        ring: brings it.
        connection: takes an error or None when the files are open, and the report at the end; any
            word on it, or its end, ends the recording.
    """
    logging.basicConfig(format="hil-bench: %(message)s")
    if hasattr(os, "nice"):
        os.nice(_NICENESS)
    wish = _EndWish()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, wish.take)
    try:
        recorder = Recorder(plan, durable=True, tell=warn)
    except ConfigError as error:
        connection.send(str(error))
        return
    connection.send(None)
    is_last = False
    while not is_last:
        # Asked before the ring is read, so that nothing written before the end is left in it.
        is_last = connection.poll(BLOCK_PERIOD) or wish.is_there
        drain(ring, recorder)
        recorder.write_block()
    report = recorder.close()
    try:
        connection.send(report)
    except OSError:
        return  # the loop's process is gone


class _EndWish:
    """Whether a signal asked for the end; the handler must touch nothing with a lock."""

    def __init__(self) -> None:
        self.is_there = False

    def take(self, _signal: int, _frame: FrameType | None) -> None:
        """Take note of it."""
        self.is_there = True


def drain(ring: SharedRing, recorder: Recorder) -> None:
    """Hand all messages in a ring to a recorder."""
    for kind, message in ring.take():
        if kind == _ROW:
            recorder.append_row(message)
        else:
            recorder.append_frames([_logged_frame(*part) for part in _FRAME.iter_unpack(message)])


def _logged_frame(now: int, can_id: int, flags: int, length: int, data: bytes) -> LoggedFrame:
    frame = Frame(
        can_id,
        data[:length],
        is_remote=bool(flags & _REMOTE),
        is_extended=bool(flags & _EXTENDED),
        bus=flags >> _BUS_SHIFT,
    )
    return LoggedFrame(frame, now, bool(flags & _RECEIVED))
