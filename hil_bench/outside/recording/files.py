"""Recordings as files: CSV with the names in the first row and the SI units in the second.

Any table tool reads it; with pandas: ``pandas.read_csv(path, skiprows=[1])``. Numbers are written
so that they read back exactly.
"""

import contextlib
import csv
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Self

import numpy as np

from hil_bench.errors import ConfigError, about_file, check_replaceable, printable
from hil_bench.outside.recording.block_file import naming
from hil_bench.outside.recording.channels import (
    TIME,
    Channel,
    Recording,
    recording_channels,
    recording_dtype,
)
from hil_bench.outside.recording.column_units import in_own_units
from hil_bench.outside.recording.mdf_reader import read_mdf


class RecordingFile:
    """A CSV file that is opened before the run and written after it.

    The rows go to ``NAME.part`` beside it, which takes the place of the file once all is written,
    so a run that fails leaves the file of the last good run alone.

    Args:
        path: the CSV file.

    Raises:
        ConfigError: the file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._part = path.with_name(path.name + ".part")
        if path.is_dir():
            raise ConfigError(f"{path}: is a directory; give the name of a file to write")
        check_replaceable(path)
        with about_file(path, right="give a file in a directory of yours"):
            self._file = self._part.open("w", encoding="utf-8", newline="")

    def write(self, recording: Recording) -> None:
        """Write the whole recording and put the file in its place."""
        channels = recording_channels(recording)
        writer = csv.writer(self._file)
        with naming(self.path):
            writer.writerow(channel.name for channel in channels)
            writer.writerow(channel.unit for channel in channels)
            writer.writerows(recording.tolist())
            self._file.close()
        self._part.replace(self.path)

    def close(self) -> None:
        """Close the file; what was not written whole is removed."""
        with contextlib.suppress(OSError):  # `write` has closed what is to stay
            self._file.close()
        self._part.unlink(missing_ok=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def read_recording(path: Path) -> Recording:
    """Return the signals of a recording, by its suffix CSV or MF4, in the bench's own units.

    A column in a unit that is not known stays as it is. A CSV file that ends in the middle of a
    row, because its writer was killed, loses that row.

    Raises:
        ConfigError: the file cannot be read or holds something else.
    """
    if path.suffix.lower() == ".mf4":
        signals = read_mdf(path).signals
        try:
            return in_own_units(signals)
        except ConfigError as error:
            raise ConfigError(f"{path}: {error}") from None
    with about_file(path, what="cannot be read", right="give a recording"):
        try:
            with path.open(encoding="utf-8", newline="") as file:
                return in_own_units(_parse(list(csv.reader(_complete_lines(file)))))
        except (ValueError, csv.Error) as error:
            raise ConfigError(f"{path}: is no recording: {printable(str(error))}") from None


def _complete_lines(lines: Iterable[str]) -> Iterator[str]:
    """Yield lines up to one that lacks its end."""
    for line in lines:
        if line.endswith("\n"):
            yield line


def _parse(rows: list[list[str]]) -> Recording:
    if len(rows) < 2:
        raise ConfigError("it has no row of names and units")
    names, units, *values = rows
    if len(names) != len(units):
        raise ConfigError(f"it has {len(names)} names and {len(units)} units")
    if names[:1] != [TIME.name]:
        raise ConfigError(f"its first column is {', '.join(names[:1]) or 'empty'}, not {TIME.name}")
    for number, row in enumerate(values, start=3):
        if len(row) != len(names):
            raise ConfigError(f"row {number} has {len(row)} values, the first has {len(names)}")
    dtype = recording_dtype([Channel(*pair) for pair in zip(names, units, strict=True)])
    return np.array([tuple(map(float, row)) for row in values], dtype=dtype)
