"""A recording that another process writes, so that the loop never waits for a disk.

The loop's side costs one copy into shared memory a tick. A recorder that is killed leaves files
that end with the last block; a loop that is killed leaves the recorder to write all it has left.
What ends a recording early is said at once, with what the files hold.
"""

import logging
import os
import struct
import sys
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from time import monotonic_ns
from typing import NamedTuple, Self

from hil_bench.abilities.common.shared_ring import SharedRing, pack_frames, unpack_frames
from hil_bench.abilities.recording.recorder import (
    BLOCK_PERIOD,
    Recorder,
    RecordingPlan,
    ended_early,
)
from hil_bench.abilities.recording.report import Progress, RecordingReport
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import ConfigError
from hil_bench.outside.helper_process import HelperProcess
from hil_bench.outside.recording.channels import LoggedFrame

logger = logging.getLogger(__name__)

CAPACITY = 8 << 20
"""Bytes between loop and recorder: several seconds of a 1 kHz bench of one axis."""

LOOK = 100_000_000
"""Time between two looks whether the recorder is well [ns]."""

_ROW, _FRAMES = 1, 2
_NICENESS = 5  # the loop comes first where both want the same core
_START_TIMEOUT = 30.0
_END_TIMEOUT = 30.0


class _Problem(NamedTuple):
    """The recorder gave a file up."""

    number: int
    text: str


class _Written(NamedTuple):
    """The recorder has written all that it was given."""


class RecorderProcess:
    """A recorder in a process of its own, as a context manager; `__enter__` starts it.

    Args:
        plan: what to record.
        clock: says when to look whether the recorder is well [ns].

    Attributes:
        plan: as passed in.
    """

    def __init__(self, plan: RecordingPlan, clock: Callable[[], int] = monotonic_ns) -> None:
        plan.check()
        self.plan = plan
        self._clock = clock
        self._look_at = clock()
        self._ring = SharedRing(CAPACITY)
        self._put: Callable[[int, bytes], bool] = self._ring.put
        self._row = struct.Struct(f"<{1 + len(plan.channels)}d")
        self._progress = Progress(plan.paths)
        self._problems: dict[int, str] = {}
        self._is_slow = self._has_ended = False
        self._helper = HelperProcess(
            record, (plan, self._ring, self._progress), name="hil-bench-recorder"
        )

    @property
    def pid(self) -> int:
        """Identifier of the process.

        Raises:
            ValueError: it has not started.
        """
        if self._helper.pid is None:
            raise ValueError("the recorder has no process yet: start() it")
        return self._helper.pid

    @property
    def report(self) -> RecordingReport:
        """Return the report of the recording so far."""
        return self._progress.report(self._problems, self._ring.lost)

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
        self._helper.start()
        try:
            answer = self._helper.receive(_START_TIMEOUT)
        except (EOFError, TimeoutError):
            ending = self._helper.ending() or f"did not start in {_START_TIMEOUT:g} s"
            answer = f"{self._names(self.plan.paths)}: the recorder's process {ending}"
        if isinstance(answer, str):
            self._helper.stop(_END_TIMEOUT)
            raise ConfigError(answer)

    def stop(self) -> None:
        """Have the process write what it has."""
        if not self._has_ended:
            self._helper.send(None)
            self._hear(_END_TIMEOUT)
        self._helper.stop(0 if self._has_ended else _END_TIMEOUT)

    def append_row(self, values: Sequence[float]) -> None:
        """Record a row: time [s], then a value a channel in its SI unit."""
        if self._clock() >= self._look_at:
            self._look()
        self._put(_ROW, self._row.pack(*values))

    def append_frames(self, frames: Sequence[Frame], now: int, *, is_received: bool) -> None:
        """Record frames.

        Args:
            frames: the frames.
            now: their time on the recording's time base [ns].
            is_received: whether we received them; we sent them otherwise.
        """
        if frames:
            if self._clock() >= self._look_at:
                self._look()
            for message in pack_frames(frames, now, is_received=is_received):
                self._put(_FRAMES, message)

    def _look(self) -> None:
        """Say what has gone wrong since the last look."""
        self._look_at = self._clock() + LOOK
        if self._has_ended:
            return
        self._hear(0)
        if self._ring.lost and not self._is_slow:
            self._is_slow = True
            logger.error(
                "%s: the recorder is too slow, or its disk: the recording has gaps from now on",
                self._names(self.plan.paths),
            )

    def _hear(self, timeout: float) -> None:
        """Take what the process says until it says nothing more.

        Args:
            timeout: longest wait for each of its words, the last of which is `_Written` [s].
        """
        try:
            while not isinstance(message := self._helper.receive(timeout), _Written):
                self._problems[message.number] = message.text
                logger.error("%s", message.text)
        except TimeoutError:
            if timeout:
                self._lose(f"did not end within {timeout:g} s")
            elif (ending := self._helper.ending()) is not None:
                self._lose(ending)
        except EOFError:
            if timeout:
                self._helper.stop(timeout)
            if (ending := self._helper.ending()) is not None:  # else it is about to end
                self._lose(ending)

    def _lose(self, ending: str) -> None:
        """Say that the process has ended, with what the files hold."""
        self._has_ended = True
        self._put = _put_nowhere
        reason = f"the recorder's process {ending}"
        left = [n for n in range(len(self.plan.paths)) if n not in self._problems]
        for number in left:
            end = self._progress.end(number)
            self._problems[number] = ended_early(self.plan.paths[number], end, reason)
        if left:
            names = self._names([self.plan.paths[number] for number in left])
            end = min(self._progress.end(number) for number in left)
            logger.error("%s", ended_early(names, end, reason))
        if self._helper.trace:
            logger.debug("recorder: %s", self._helper.trace)

    @staticmethod
    def _names(paths: Sequence[object]) -> str:
        return ", ".join(map(str, paths))


def record(
    plan: RecordingPlan, ring: SharedRing, progress: Progress, connection: Connection
) -> None:
    """Write what comes through the ring until told to end, or until the loop's process is gone.

    Args:
        plan: what to record.
        ring: brings it.
        progress: counts what the files hold.
        connection: takes an error or None when the files are open, each problem, and a word at the
            end; any word on it, or its end, ends the recording.
    """
    if hasattr(os, "nice"):
        os.nice(_NICENESS)

    def tell(number: int, text: str) -> None:
        send(connection, _Problem(number, text), text)

    try:
        recorder = Recorder(plan, durable=True, tell=tell, progress=progress)
    except ConfigError as error:
        connection.send(str(error))
        return
    connection.send(None)
    is_last = False
    while not is_last:
        # Asked before the ring is read, so that nothing written before the end is left in it.
        is_last = connection.poll(BLOCK_PERIOD)
        drain(ring, recorder)
        recorder.write_block()
    recorder.close()
    send(connection, _Written())


def send(connection: Connection, message: object, text: str = "") -> None:
    """Send the loop a message; where it is gone, a text goes to standard error."""
    try:
        connection.send(message)
    except OSError:
        if text:
            sys.stderr.write(f"hil-bench: {text}\n")


def _put_nowhere(_kind: int, _message: bytes) -> bool:
    """Leave a message out that no recorder is there for."""
    return False


def drain(ring: SharedRing, recorder: Recorder) -> None:
    """Hand all messages in a ring to a recorder."""
    for kind, message in ring.take():
        if kind == _ROW:
            recorder.append_row(message)
        else:
            recorder.append_frames([LoggedFrame(*each) for each in unpack_frames(message)])
