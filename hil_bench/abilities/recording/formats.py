"""The file formats of recordings, by suffix."""

import csv
import io
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from hil_bench.abilities.common.block_file import BUS_LOGS, BlockFile, opening
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import TIME, Channel, Recording

# Signals as CSV, written block by block: names in the first row, SI units in the second.


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


SIGNAL_SUFFIXES = (".csv", ".mf4")
"""Formats with a place for signals."""

FRAME_SUFFIXES = (*BUS_LOGS, ".mf4")
"""Formats with a place for frames."""

SUFFIXES = (".csv", *BUS_LOGS, ".mf4")
"""All formats."""


class Heading(NamedTuple):
    """The heading of a recording, in the formats with a place for it.

    Attributes:
        comment: in words.
        started: date of time 0; None where time is virtual.
    """

    comment: str = ""
    started: datetime | None = None


NO_HEADING = Heading()


def check_suffix(path: Path) -> None:
    """Refuse a file whose suffix stands for no format.

    Raises:
        ConfigError: it says which do.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise ConfigError(
            f'{path}: no recording has the suffix "{path.suffix}"; give a file name that ends in '
            ".mf4 (signals and frames), .csv (signals), .blf, .asc or .log (frames)"
        )


def open_block_file(
    path: Path, channels: Sequence[Channel], heading: Heading = NO_HEADING
) -> BlockFile:
    """Return a new file of a recording; a `ConfigError` where it cannot be written.

    Args:
        path: the file; its suffix, one of `SUFFIXES`, is its format.
        channels: the signals after `TIME`.
        heading: what it says of itself.
    """
    check_suffix(path)
    with opening(path):
        return _open(path, channels, heading)


def _open(path: Path, channels: Sequence[Channel], heading: Heading) -> BlockFile:
    match path.suffix.lower():
        case ".csv":
            return SignalCsvFile(path, (TIME, *channels))
        case ".mf4":
            from hil_bench.abilities.recording.mdf_writer import MdfFile  # noqa: PLC0415 - wants NumPy

            return MdfFile(
                path, (TIME, *channels), comment=heading.comment, started=heading.started
            )
        case _:
            from hil_bench.abilities.recording.frames import open_frame_file  # noqa: PLC0415 - wants can

            return open_frame_file(path, heading.started)
