"""Tables of other tools: CSV of any delimiter, and MAT files of version 7 and before."""

import csv
import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.common.block_file import READ_LOGS
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
from hil_bench.outside.recording.channels import (
    TIME,
    Channel,
    Recording,
    recording_channels,
    recording_dtype,
)
from hil_bench.units import read_unit

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

_NO_TABLES = frozenset((".toml", ".html", ".xml", ".json", ".py", ".png", ".svg", ".pdf", ".eds"))
"""Files of a bench that are given in the place of a recording, though rows may be numbers."""

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
    if suffix in _NO_TABLES and path.exists():
        right = f"{suffix} is the suffix of no table; give .mf4, .csv or the like"
        raise ConfigError(f"{path}: is no recording: {right}")
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
