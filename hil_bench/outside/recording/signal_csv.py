"""Signals as CSV, written block by block: names in the first row, SI units in the second."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from hil_bench.outside.recording.block_file import OutputFile
from hil_bench.outside.recording.channels import Channel, Recording
from hil_bench.outside.recording.logged_frame import LoggedFrame


class SignalCsvFile:
    """A CSV file of signals, in the format of `RecordingFile`.

    Args:
        path: the file.
        channels: the signals, `TIME` first.

    Raises:
        ConfigError: the file cannot be written.
    """

    def __init__(self, path: Path, channels: Sequence[Channel]) -> None:
        self.path = path
        names = [channel.name for channel in channels]
        units = [channel.unit for channel in channels]
        self._file = OutputFile(path, _csv_text([names, units]))

    def write_rows(self, rows: Recording) -> None:
        """Append rows of the channels."""
        self._file.append(_csv_text(rows.tolist()))

    def write_frames(self, frames: Sequence[LoggedFrame]) -> None:
        """Leave frames out: the format has no place for them."""

    def flush(self, *, durable: bool) -> None:
        """Put on the disk what was written; see `OutputFile.flush`."""
        self._file.flush(durable=durable)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def abandon(self) -> None:
        """Close the file as it is."""
        self._file.abandon()


def _csv_text(rows: Sequence[Sequence[object]]) -> bytes:
    text = io.StringIO()
    csv.writer(text).writerows(rows)
    return text.getvalue().encode()
