"""Bus traffic as a file, in the formats that CAN tools read."""

from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

import can
from can.io.generic import MessageWriter

from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import ConfigError

SUFFIXES = (".asc", ".blf", ".csv", ".log", ".trc")
"""Vector's ASC and BLF, CSV, candump's log, PEAK's trace (in which python-can writes no remote
frames)."""


class _Entry(NamedTuple):
    now: int
    frame: Frame
    is_received: bool


class FrameFile:
    """A file of frames that is opened before the run and written when it is closed.

    Until then the frames stay in memory, because a tick must not wait for a disk. When `capacity`
    is reached, the oldest frame makes room.

    Args:
        path: the file; its suffix, one of `SUFFIXES`, is its format.
        channel: the name of the channel that the file gives.
        capacity: frames that are kept.

    Attributes:
        dropped: frames that had to make room.

    Raises:
        ConfigError: the suffix is unknown, or the file cannot be written.
    """

    def __init__(self, path: Path, *, channel: str = "can0", capacity: int = 1_000_000) -> None:
        self.path = path
        self.dropped = 0
        self._channel = channel
        self._entries: deque[_Entry] = deque(maxlen=capacity)
        self._writer = _open_writer(path)

    def append(self, frame: Frame, now: int, *, is_received: bool) -> None:
        """Keep one frame.

        Args:
            frame: the frame.
            now: when it was on the bus, in the bench's time [ns].
            is_received: whether the bench received it; otherwise the bench sent it.
        """
        self.dropped += len(self._entries) == self._entries.maxlen
        self._entries.append(_Entry(now, frame, is_received))

    def close(self) -> None:
        """Write all frames and close the file."""
        for entry in self._entries:
            self._writer(_to_message(entry, self._channel))
        self._entries.clear()
        self._writer.stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


def log_frames(
    exchange: Callable[[Sequence[Frame], int], Sequence[Frame]], file: FrameFile
) -> Callable[[Sequence[Frame], int], Sequence[Frame]]:
    """Return a bench's `tick` or `serve` that also keeps its frames, received ones first."""

    def exchange_and_log(frames: Sequence[Frame], now: int) -> Sequence[Frame]:
        sent = exchange(frames, now)
        for frame in frames:
            file.append(frame, now, is_received=True)
        for frame in sent:
            file.append(frame, now, is_received=False)
        return sent

    return exchange_and_log


def _open_writer(path: Path) -> MessageWriter:
    if path.suffix.lower() not in SUFFIXES:
        right = f"give a file name that ends in one of {' '.join(SUFFIXES)}"
        raise ConfigError(f'{path}: no format has the suffix "{path.suffix}"; {right}')
    try:
        return can.Logger(path)
    except OSError as error:
        right = "give a file in a directory of yours"
        raise ConfigError(f"{path}: cannot be written: {error.strerror}; {right}") from None


def _to_message(entry: _Entry, channel: str) -> can.Message:
    return can.Message(
        timestamp=entry.now * 1e-9,
        arbitration_id=entry.frame.can_id,
        is_extended_id=entry.frame.is_extended,
        is_remote_frame=entry.frame.is_remote,
        data=entry.frame.data,
        is_rx=entry.is_received,
        channel=channel,
    )
