"""Recordings that are read: our own files, and those of others, in the bench's units."""

import csv
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from hil_bench.abilities.recording.foreign_tables import as_recording, read_columns
from hil_bench.abilities.recording.mdf_reader import read_mdf
from hil_bench.config.values import quote
from hil_bench.errors import ConfigError, about_file, printable
from hil_bench.outside.recording.channels import (
    TIME,
    Channel,
    Recording,
    recording_channels,
    recording_dtype,
)
from hil_bench.outside.recording.signal_table import SignalTable, as_table
from hil_bench.units import read_unit

# Units of the columns of a file: each becomes the bench's own unit, once; every reader ends here.
#
# A unit that is not known stays as it is: its values are drawn, and compared with nothing that has
# a unit.

_GIVEN = "given"  # metadata of a field: the unit that the file has, where it is another one


def in_own_units(recording: Recording) -> Recording:
    """Return a recording with each column in the bench's unit, the time in seconds.

    Args:
        recording: as the file has it, its columns with the file's units.

    Raises:
        ConfigError: the time is in no unit of time.
    """
    channels = recording_channels(recording)
    found = [read_unit(channel.unit) for channel in channels]
    if found[0] is None or found[0].symbol != TIME.unit:
        given = f'is in "{channels[0].unit}"' if channels[0].unit else "has no unit"
        raise ConfigError(f"its time {given}; give it in s, ms, us or min, as in time [s]")
    own = [
        channel if unit is None else Channel(channel.name, unit.symbol)
        for channel, unit in zip(channels, found, strict=True)
    ]
    if own == list(channels):
        return recording
    converted = np.empty(len(recording), dtype=_dtype(own, channels))
    for channel, unit in zip(channels, found, strict=True):
        values = recording[channel.name]
        if unit is not None and (unit.factor, unit.offset) != (1.0, 0.0):
            values = values * unit.factor + unit.offset
        converted[channel.name] = values
    return converted


def _dtype(own: Iterable[Channel], given: Iterable[Channel]) -> "np.dtype[np.void]":
    """Return the type of the rows; a column that was converted keeps its file's unit, too."""
    plain = recording_dtype(tuple(own))
    fields: list[Any] = []
    for channel, (_, symbol) in zip(own, given, strict=True):
        metadata = dict(plain[channel.name].metadata or {})
        if symbol != channel.unit:
            metadata[_GIVEN] = symbol
        fields.append((channel.name, np.dtype(np.float64, metadata=metadata)))
    return np.dtype(fields)


def given_units(recording: Recording) -> dict[str, str]:
    """Return the unit that the file has of each column that was converted from it."""
    units = {
        name: dict(recording.dtype[name].metadata or {}).get(_GIVEN)
        for name in recording.dtype.names or ()
    }
    return {name: symbol for name, symbol in units.items() if symbol is not None}


# Our own files, and those of others.


def read_recording(path: Path) -> Recording:
    """Return the signals of a recording, by its suffix CSV or MF4, in the bench's own units.

    A column in a unit that is not known stays as it is. A CSV file that ends in the middle of a
    row, because its writer was killed, loses that row. The columns of another tool keep their
    names, less the brackets with the unit.

    Raises:
        ConfigError: the file cannot be read or holds something else.
    """
    is_mf4 = path.suffix.lower() == ".mf4"
    recording = read_mdf(path).signals if is_mf4 else _read_csv(path)
    try:
        return in_own_units(recording)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None


def open_recording(path: Path | str) -> SignalTable:
    """Return the signals of a recording, ``.csv`` or ``.mf4``; see `read_recording`."""
    return as_table(read_recording(Path(path)))


def _read_csv(path: Path) -> Recording:
    with about_file(path, what="cannot be read", right="give a recording"):
        try:
            if is_csv_of_bench(path):
                return _read_ours(path)
        except UnicodeDecodeError:  # of another tool, and in another code page
            pass
        except (ValueError, csv.Error) as error:
            raise ConfigError(f"{path}: is no recording: {printable(str(error))}") from None
    table = read_columns(path)
    try:
        return as_recording(*table)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None


def is_csv_of_bench(path: Path) -> bool:
    """Return True if a file begins as the bench's own CSV: time, and its unit alone below."""
    with path.open(encoding="utf-8", errors="replace", newline="") as file:
        rows = csv.reader(file)
        names, units = next(rows, []), next(rows, [])
    return names[:1] == [TIME.name] and read_unit("".join(units[:1])) is not None


def _read_ours(path: Path) -> Recording:
    with path.open(encoding="utf-8", newline="") as file:
        return _parse(list(csv.reader(_complete_lines(file))))


def _complete_lines(lines: Iterable[str]) -> Iterator[str]:
    """Yield lines up to one that lacks its end."""
    for line in lines:
        if line.endswith("\n"):
            yield line


def _parse(rows: list[list[str]]) -> Recording:
    names, units, *values = rows
    if len(names) != len(units):
        raise ConfigError(f"it has {len(names)} names and {len(units)} units")
    for number, row in enumerate(values, start=3):
        if len(row) != len(names):
            raise ConfigError(f"row {number} has {len(row)} values, the first has {len(names)}")
    dtype = recording_dtype([Channel(*pair) for pair in zip(names, units, strict=True)])
    try:
        return np.array([tuple(map(float, row)) for row in values], dtype=dtype)
    except ValueError:
        for number, row in enumerate(values, start=3):
            for name, field in zip(names, row, strict=True):
                _check_number(f"row {number}, column {name}", field)
        raise


def _check_number(place: str, field: str) -> None:
    """Refuse a field that is no number.

    Raises:
        ConfigError: it is none.
    """
    try:
        float(field)
    except ValueError:
        wrong = f"{quote(field)} is not a number" if field.strip() else "is empty"
        raise ConfigError(f"{place}: {wrong}; write nan for an unknown value") from None
