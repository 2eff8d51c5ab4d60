"""Signals as CSV, written block by block: names in the first row, SI units in the second."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from hil_bench.outside.recording.block_file import BlockFile
from hil_bench.outside.recording.channels import Channel, Recording


class SignalCsvFile(BlockFile):
    """A CSV file of signals, in the format of `RecordingFile`.

    Args:
        path: the file.
        channels: the signals, `TIME` first.

    Raises:
        ConfigError: the file cannot be written.
    """

    def __init__(self, path: Path, channels: Sequence[Channel]) -> None:
        names = [channel.name for channel in channels]
        units = [channel.unit for channel in channels]
        super().__init__(path, _csv_text([names, units]))

    def write_rows(self, rows: Recording) -> None:
        """Append rows of the channels."""
        self._file.append(_csv_text(rows.tolist()))


def _csv_text(rows: Sequence[Sequence[object]]) -> bytes:
    text = io.StringIO()
    csv.writer(text).writerows(rows)
    return text.getvalue().encode()
