"""The recorder of frames and signals, and its trigger."""

import logging
import re
import struct
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Protocol

from hil_bench.abilities.recording.formats import Heading, check_suffix, open_block_file
from hil_bench.abilities.recording.report import Counted, Progress, RecordingReport
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import (
    TIME,
    Channel,
    LoggedFrame,
    Recording,
    RowSink,
    recording_dtype,
)
from hil_bench.units import quantity

if TYPE_CHECKING:
    from hil_bench.abilities.common.block_file import BlockFile


# The trigger of a recording: a signal that crosses a level.

_CONDITION = re.compile(r"\s*(\S+?)\s*([<>])\s*([-+.\deE]+)\s*(\S*)\s*")


class Trigger(NamedTuple):
    """A signal beyond a level.

    Attributes:
        channel: name of the signal.
        is_above: whether it must be above the level; below otherwise.
        level: in the signal's SI unit.
    """

    channel: str
    is_above: bool
    level: float

    def first(self, rows: Recording) -> int | None:
        """Return the number of the first row that is beyond the level, None for none."""
        import numpy as np  # noqa: PLC0415 - whose rows these are

        values = rows[self.channel]
        hits = np.flatnonzero(values > self.level if self.is_above else values < self.level)
        return int(hits[0]) if hits.size else None


def parse_trigger(text: str, channels: Sequence[Channel]) -> Trigger:
    """Return the trigger that a text such as ``axis1.P_A > 80 bar`` describes.

    Args:
        text: channel, ``<`` or ``>``, level, and its unit where it is not the SI unit.
        channels: the signals there are.

    Raises:
        ConfigError: it says what is wrong.
    """
    match = _CONDITION.fullmatch(text)
    if match is None:
        raise ConfigError(f'trigger "{text}": write it as in "axis1.P_A > 80 bar"')
    name, relation, level, symbol = match.groups()
    units = {channel.name: channel.unit for channel in (TIME, *channels)}
    if name not in units:
        raise ConfigError(f'trigger "{text}": no signal {name}; there are {", ".join(units)}')
    return Trigger(name, relation == ">", quantity(text, level, symbol, units[name]))


# Takes rows and frames, and writes them to the files of a recording in blocks.
#
# With a trigger nothing is written until it comes; what the time before it brought is held in a
# ring and written then. A file that can no longer be written is given up with a line; the others go
# on.

logger = logging.getLogger(__name__)

BLOCK_PERIOD = 0.25
"""Time of one block [s]: what a recording can lose at its end."""


@dataclass(frozen=True, slots=True)
class RecordingPlan:
    """The plan of a recording: files, channels and trigger.

    Attributes:
        paths: the files; their suffixes are their formats.
        channels: the signals, without the time.
        trigger: what begins it, as in ``axis1.P_A > 80 bar``; empty for the start.
        pre_trigger: time before the trigger that is recorded too [s].
        heading: what the files say of themselves.
    """

    paths: tuple[Path, ...]
    channels: tuple[Channel, ...]
    trigger: str = ""
    pre_trigger: float = 1.0
    heading: Heading = field(default_factory=Heading)

    def check(self) -> None:
        """Refuse what cannot be meant, before anything is opened."""
        for path in self.paths:
            check_suffix(path)
        if self.trigger:
            parse_trigger(self.trigger, self.channels)


class Recorder:
    """A recording that is being written.

    Args:
        plan: what to record.
        durable: have each block on the disk, not only with the system.
        tell: takes the number of a file that is given up and why, in one line, when it happens.
        progress: counts what the files hold; without it one of its own.
    """

    def __init__(
        self,
        plan: RecordingPlan,
        *,
        durable: bool,
        tell: Callable[[int, str], None],
        progress: Progress | None = None,
    ) -> None:
        plan.check()
        self._files: dict[int, BlockFile] = {}
        try:
            for number, path in enumerate(plan.paths):
                self._files[number] = open_block_file(path, plan.channels, plan.heading)
        except BaseException:
            for file in self._files.values():
                file.abandon()
            raise
        self._dtype = recording_dtype((TIME, *plan.channels))
        self._trigger = parse_trigger(plan.trigger, plan.channels) if plan.trigger else None
        self._history = _History(plan.pre_trigger)
        self._durable = durable
        self._tell = tell
        self._rows: list[bytes] = []
        self._frames: list[LoggedFrame] = []
        self._problems: dict[int, str] = {}
        self._progress = Progress(plan.paths) if progress is None else progress
        if self._trigger is None:
            self._progress.trigger()

    @property
    def report(self) -> RecordingReport:
        """Return the report of the recording so far."""
        return self._progress.report(self._problems)

    def append_row(self, row: bytes) -> None:
        """Take a row: time [s] and a value a channel in its SI unit, as float64."""
        self._rows.append(row)

    def append_frames(self, frames: Sequence[LoggedFrame]) -> None:
        """Take frames."""
        self._frames += frames

    def write_block(self) -> None:
        """Write what was taken since the last block."""
        import numpy as np  # noqa: PLC0415 - as `channels` does

        rows = np.frombuffer(b"".join(self._rows), dtype=np.float64).view(self._dtype)
        frames, self._rows, self._frames = self._frames, [], []
        if self._trigger is not None:
            self._history.add(rows, frames)
            first = self._trigger.first(rows)
            if first is None:
                return
            rows, frames = self._history.since(float(rows[TIME.name][first]))
            self._trigger = None
            self._progress.trigger()
        self._write(rows, frames)

    def close(self) -> RecordingReport:
        """Write the last block, close the files and return what the recording holds."""
        self.write_block()
        for number, file in list(self._files.items()):
            try:
                file.flush(durable=self._durable)  # the links of the last block
                file.close()
            except OSError as error:
                self._give_up(number, error)
        self._files.clear()
        return self.report

    def _write(self, rows: Recording, frames: Sequence[LoggedFrame]) -> None:
        end = round(float(rows[TIME.name][-1]) * 1e9) if len(rows) else 0
        for number, file in list(self._files.items()):
            try:
                file.write_rows(rows)
                file.write_frames(frames)
                file.flush(durable=self._durable)
            except OSError as error:
                self._give_up(number, error)
            else:
                last = frames[-1].now if frames else 0
                self._progress.count(number, Counted(len(rows), end), Counted(len(frames), last))

    def _give_up(self, number: int, error: OSError) -> None:
        file = self._files.pop(number)
        end, reason = self._progress.end(number), error.strerror or str(error)
        self._problems[number] = ended_early(file.path, end, reason)
        self._tell(number, self._problems[number])
        file.abandon()


def ended_early(path: Path | str, end: float, reason: str) -> str:
    """Return the message on one or more files whose recording ended at a time [s]."""
    return f"{path}: recording ended at {end:.3f} s: {reason}; what was written before is readable"


def warn(_number: int, problem: str) -> None:
    """Log a problem of a recording at once, in a line."""
    logger.error("%s", problem)


class _History:
    """The latest rows and frames.

    Args:
        reach: how far back [s].
    """

    def __init__(self, reach: float) -> None:
        self._reach = reach
        self._rows: deque[Recording] = deque()
        self._frames: deque[LoggedFrame] = deque()

    def add(self, rows: Recording, frames: Sequence[LoggedFrame]) -> None:
        """Take a block, and forget what is too old."""
        if len(rows):
            self._rows.append(rows)
            oldest = float(rows[TIME.name][0]) - self._reach
            while self._rows and self._rows[0][TIME.name][-1] < oldest:
                self._rows.popleft()
            while self._frames and self._frames[0].now < oldest * 1e9:
                self._frames.popleft()
        self._frames.extend(frames)

    def since(self, trigger: float) -> tuple[Recording, list[LoggedFrame]]:
        """Return rows and frames from the reach before the trigger [s] to now."""
        import numpy as np  # noqa: PLC0415 - as `channels` does

        start = trigger - self._reach
        rows = np.concatenate(list(self._rows))
        frames = [logged for logged in self._frames if logged.now >= start * 1e9]
        return rows[rows[TIME.name] >= start], frames


# A recording written by the one whose ticks it records: for virtual time, which can wait.


class RecordingSink(RowSink, Protocol):
    """Takes what is to be recorded: `RecorderProcess` and `InlineRecorder`."""

    @property
    def report(self) -> RecordingReport:
        """Return the report of the recording so far."""

    def start(self) -> None:
        """Open the files."""

    def stop(self) -> None:
        """Write what there is and close the files."""

    def append_frames(self, frames: Sequence[Frame], now: int, *, is_received: bool) -> None:
        """Record frames at a time [ns] that we received, or else sent."""


class InlineRecorder:
    """A recorder in the caller's thread that writes a block each `BLOCK_PERIOD` of bench time.

    Args:
        plan: what to record.
    """

    def __init__(self, plan: RecordingPlan) -> None:
        plan.check()
        self._plan = plan
        self._row = struct.Struct(f"<{1 + len(plan.channels)}d")
        self._block_end = BLOCK_PERIOD

    @property
    def report(self) -> RecordingReport:
        """Return the report of the recording so far."""
        return self._recorder.report

    def start(self) -> None:
        """Open the files."""
        self._recorder = Recorder(self._plan, durable=False, tell=warn)

    def stop(self) -> None:
        """Write what there is and close the files."""
        self._recorder.close()

    def append_row(self, values: Sequence[float]) -> None:
        """Record a row: time [s], then a value a channel in its SI unit."""
        self._recorder.append_row(self._row.pack(*values))
        self._end_block(values[0])

    def append_frames(self, frames: Sequence[Frame], now: int, *, is_received: bool) -> None:
        """Record frames at a time [ns] that we received, or else sent."""
        self._recorder.append_frames([LoggedFrame(frame, now, is_received) for frame in frames])
        self._end_block(now * 1e-9)

    def _end_block(self, time: float) -> None:
        if time >= self._block_end:
            self._block_end = time + BLOCK_PERIOD
            self._recorder.write_block()


# Records what passes a bus as a controller sees it.
