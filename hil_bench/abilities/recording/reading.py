"""Recordings that are read: our own files, and those of others, in the bench's units."""

import csv
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.recording.mat_reader import read_vectors
from hil_bench.abilities.recording.mdf_reader import read_mdf
from hil_bench.abilities.recording.table_heads import (
    END_OF_HEAD,
    IN_BRACKETS,
    Head,
    plain_lines,
    read_head,
    times_of,
)
from hil_bench.canopen_device.eds_document import decode_text
from hil_bench.config.values import quote
from hil_bench.errors import ConfigError, about_file, printable
from hil_bench.outside.recording.block_file import READ_LOGS
from hil_bench.outside.recording.channels import (
    TIME,
    Channel,
    Recording,
    recording_channels,
    recording_dtype,
)
from hil_bench.outside.recording.signal_table import SignalTable, as_table
from hil_bench.units import read_unit

# Tables of other tools: CSV of any delimiter, and MAT files of version 7 and before.


Values = npt.NDArray[np.float64]

Columns = dict[str, Values]
"""The columns of a table by their names, all of one length."""

Units = dict[str, str]
"""The units that a table gives its columns, by the names of these; less than all may have one."""

_DELIMITERS = ";\t,"
_SEPARATOR = re.compile(r"\s*sep=.\s*", re.IGNORECASE)
"""A first line by which spreadsheets know the delimiter."""

_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}([.,'\u2019 \u00a0\u202f])\d{3}(?:\1\d{3})*(?:[.,]\d+)?")
"""A number in which marks may part groups of three digits."""
_DECIMAL = re.compile(r"[+-]?\d*([.,])\d+(?:[eE][+-]?\d+)?")

_SAVVYCAN = frozenset(("ID", "Extended", "LEN"))
"""Among the names of a log of frames as SavvyCAN (GVRET) writes it."""

_HEAD = 50  # lines among which the one with the names is
_TIMES = frozenset({"time", "t", "zeit"})


def read_columns(path: Path) -> tuple[Columns, Units]:
    """Return the columns of a table and their units, by its suffix CSV (or text), MAT or our MF4.

    The names of a CSV file are in its first row with as many fields as the numbers below have, the
    units behind the names or in the row below; a MAT file has no units. Other rows between are left
    out. A field that is no number counts as not a number.

    Raises:
        ConfigError: the file cannot be read, or has no columns of numbers.
    """
    suffix = path.suffix.lower()
    if suffix == ".mf4":
        signals = read_mdf(path).signals
        columns = {name: np.asarray(signals[name]) for name in signals.dtype.names or ()}
        return columns, {name: unit for name, unit in recording_channels(signals) if unit}
    with about_file(path, what="cannot be read", right="give a recording"):
        try:
            return (_read_mat(path), {}) if suffix == ".mat" else _read_text(path)
        except (ValueError, csv.Error) as error:
            wrong = f"{path}: is no recording: {printable(str(error))}"
            if suffix in READ_LOGS:
                wrong = (
                    f"{path}: holds no signals, as the log of frames that it is by its name; "
                    f"'hil-bench decode {path} bench.toml -o decoded.mf4' makes signals of one"
                )
            raise ConfigError(wrong) from None


def as_recording(columns: Columns, units: Units) -> Recording:
    """Return a table of another tool as a recording, in its own units.

    The time is the column that is called time, t or Zeit, else the first of all; of several, the
    first with a unit of time. Brackets with the unit are no part of a name, and two columns of one
    name are a `ConfigError`.

    Args:
        columns: of the table, as `read_columns` returns them.
        units: likewise.

    Raises:
        ConfigError: no column is a time, or two have one name.
    """
    names = {column: _less_unit(column, units.get(column, "")) for column in columns}
    called = [column for column, name in names.items() if name.casefold() in _TIMES]
    first = next(iter(columns))
    in_time = (column for column in (*called, first) if _is_in_time(units.get(column, "")))
    time = next(in_time, next(iter(called), None))
    if time is None:
        wrong = f"it has no column time, and the first, {printable(first)}, is in no unit of time"
        raise ConfigError(f"{wrong}; name the one with the time, as in time [s], or with --map")
    if len(columns[time]) and not np.isfinite(columns[time]).any():
        wrong = f"its time, {printable(time)}, is no number in any row"
        raise ConfigError(f"{wrong}; give it in s, as 43201.5 for 12:00:01.5")
    names = {time: TIME.name} | {column: names[column] for column in columns if column != time}
    channels = [Channel(name, units.get(column, "")) for column, name in names.items()]
    recording = np.empty(len(columns[time]), dtype=recording_dtype(channels))
    for column, name in names.items():
        recording[name] = columns[column]
    return recording


def _less_unit(column: str, symbol: str) -> str:
    """Return the name of a column without the brackets that hold its unit, and nothing else."""
    found = IN_BRACKETS.search(column)
    is_unit = found is not None and found[1] == symbol
    return (IN_BRACKETS.sub("", column) if is_unit else column).strip() or column


def _is_in_time(symbol: str) -> bool:
    unit = read_unit(symbol)
    return unit is not None and unit.symbol == TIME.unit


def _read_lines(path: Path) -> tuple[list[str], str]:
    """Return the lines of a table that have their ends, and its delimiter."""
    text = decode_text(path.read_bytes())
    lines = text.splitlines()
    if text[-1:] not in {"", "\n", "\r"}:
        lines.pop()  # its writer may have been killed within a number
    if lines and _SEPARATOR.fullmatch(lines[0]):
        lines[0] = ""
    lines = plain_lines(lines)
    return lines, max(_DELIMITERS, key=lambda one: sum(one in line for line in lines[:_HEAD]))


def _split(lines: list[str], delimiter: str) -> tuple[list[list[str]], int, list[str]]:
    """Return the rows above the first row of numbers, the line of that, and that.

    Raises:
        ConfigError: there is no row of numbers.
    """
    reader, line = csv.reader(lines, delimiter=delimiter), 0
    heads: list[list[str]] = []
    has_ended = False  # LVM's head: its rows need no time
    for row in reader:
        first = row[1:2] if has_ended and row and not row[0].strip() else row
        if first and np.isfinite(_number(first[0], delimiter)):
            return heads, line, row
        if row:
            has_ended |= row[0] == END_OF_HEAD
            heads.append(row)
        line = reader.line_num
    wrong = "it has no row of numbers"
    if lines and any(map(str.isdigit, lines[-1])):  # dates, or decimal commas between commas
        wrong += (
            f": its last line is {lines[-1]!a:.60}; decimal numbers, also of the time, are right, "
            "as 43201.5 below time [s] for 12:00:01.5"
        )
    raise ConfigError(wrong)


def _read_text(path: Path) -> tuple[Columns, Units]:
    lines, delimiter = _read_lines(path)
    above, first, row = _split(lines, delimiter)
    head = read_head(above, row)
    if set(head.names) >= _SAVVYCAN:
        raise ConfigError(
            "it is a log of frames with bytes in hexadecimal; save it as .log or .asc, as SavvyCAN "
            "does, and 'hil-bench decode' makes signals of it"
        )
    try:
        values = _read_quickly(lines[first:], delimiter, head, len(row))
    except ValueError:
        values = _read_slowly(lines[first:], delimiter, head, first)
    columns = _named(head.names, values)
    units = dict(zip(head.names, head.units, strict=False))
    for name in head.names:
        found = IN_BRACKETS.search(name)
        if found is None:
            continue
        unit, below = read_unit(found[1]), units.get(name, "")
        if unit and unit != (read_unit(below) or unit):
            raise ConfigError(f"column {name} is in {below} by the row of units; give it one unit")
        if unit or not below:
            units[name] = found[1]
    if head.clock is not None:
        columns = {TIME.name: times_of(head.clock, values)} | columns
        units[TIME.name] = TIME.unit
        if head.clock.column is not None:
            del columns[head.names[head.clock.column]]
    return columns, units


def _named(names: list[str], values: Values) -> Columns:
    """Return the columns that have a name; one that is there again is one.

    Raises:
        ConfigError: two of one name have other numbers.
    """
    columns: Columns = {}
    for name, column in zip(names, values.T, strict=True):
        if name and name in columns and not np.array_equal(columns[name], column, equal_nan=True):
            raise ConfigError(
                f"it has the column {name} twice, with other numbers; rename one, or leave it out"
            )
        if name:
            columns.setdefault(name, column)
    return columns


def _read_quickly(lines: list[str], delimiter: str, head: Head, wide: int) -> Values:
    """Return the numbers of a table whose rows are `wide`, with empty fields behind its columns.

    Raises:
        ValueError: it has other fields, or rows of another length.
    """
    width = len(head.names)
    if wide > width:
        lines = [line.rstrip(f"{delimiter} ") for line in lines]
    if lines[-1].count(delimiter) < width - 1:
        lines = lines[:-1]  # its writer was killed
    if delimiter != ",":
        marks = {mark for mark in ",." if any(mark in line for line in lines)}
        if len(marks) > 1:
            raise ValueError
        lines = [line.replace(",", ".") for line in lines]
    values = np.loadtxt(lines, delimiter=delimiter, comments=None, quotechar='"', ndmin=2)
    if values.shape[1] != width:
        raise ValueError
    return values


def _read_slowly(lines: list[str], delimiter: str, head: Head, above: int) -> Values:
    """Return the numbers of a table, not a number where a field is none.

    Raises:
        ConfigError: its rows differ in length, or a number may be read in two ways.
    """
    width = len(head.names)
    reader = csv.reader(lines, delimiter=delimiter)
    body = [(above + reader.line_num, _cut(row, head)) for row in reader if row]
    if len(body[-1][1]) < width:
        del body[-1]  # its writer was killed
    for number, row in body:
        if len(row) != width:
            raise ConfigError(
                f"row {number} has {len(row)} values, the first has {width}; "
                "give columns of one length"
            )
    check_marks(
        (f"row {number}, column {name}", field)
        for number, row in body
        for name, field in zip(head.names, row, strict=True)
    )
    return np.array([[_number(field, delimiter) for field in row] for _, row in body])


def _cut(row: list[str], head: Head) -> list[str]:
    """Return a row less what stands behind its columns: remarks, or empty fields."""
    width = len(head.names)
    has_end = not head.has_remarks and any(map(str.strip, row[width:]))
    return row if has_end else row[:width]


def check_marks(fields: Iterable[tuple[str, str]]) -> None:
    """Refuse thousands points, commas and blanks: read as decimal marks, they change a number.

    A single one, as in "1.234", can be told from a decimal mark only by the other numbers.

    Args:
        fields: of a table, each behind its place.

    Raises:
        ConfigError: a number has them, or may have.
    """
    grouped, decimal = dict[str, tuple[str, str]](), dict[str, str]()
    for place, field in fields:
        text = field.strip()
        if found := _GROUPED.fullmatch(text):
            mark = found[1]
            if mark not in ",." or sum(map(text.count, ",.")) > 1:
                plain = re.sub(rf"\{mark}(?=\d{{3}})", "", text)
                wrong = f"{quote(text)} has marks between thousands"
                raise ConfigError(f"{place}: {wrong}; write it without, as {plain}")
            grouped.setdefault(mark, (place, text))
        elif found := _DECIMAL.fullmatch(text):
            decimal.setdefault(found[1], text)
    for mark, (place, text) in grouped.items():
        others = [each for each in decimal if each != mark]
        if others:
            plain, other = text.replace(mark, ""), decimal[others[0]]
            wrong = (
                f"{quote(text)} may be {plain} or {text.replace(mark, '.')} beside {quote(other)}"
            )
            raise ConfigError(f"{place}: {wrong}; write all numbers with one decimal mark alone")


def _number(text: str, delimiter: str) -> float:
    try:
        return float(text if delimiter == "," else text.replace(",", "."))
    except ValueError:
        return np.nan


def _read_mat(path: Path) -> Columns:
    series = read_vectors(path)
    lengths = [len(values) for values in series.values()]
    if not lengths:
        raise ConfigError("it has no vector of numbers")
    longest = max(set(lengths), key=lambda length: (lengths.count(length), length))
    return {name: values for name, values in series.items() if len(values) == longest}


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
