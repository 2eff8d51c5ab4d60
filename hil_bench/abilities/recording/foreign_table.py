"""Tables of other tools: CSV of any delimiter, and MAT files of version 7 and before."""

import csv
import re
from pathlib import Path

import numpy as np
import numpy.typing as npt

from hil_bench.abilities.recording.mat_reader import read_vectors
from hil_bench.abilities.recording.mdf_reader import read_mdf
from hil_bench.errors import ConfigError, about_file, printable
from hil_bench.outside.recording.channels import (
    TIME,
    Channel,
    Recording,
    recording_channels,
    recording_dtype,
)

Values = npt.NDArray[np.float64]

Columns = dict[str, Values]
"""The columns of a table by their names, all of one length."""

Units = dict[str, str]
"""The units that a table gives its columns, by the names of these; less than all may have one."""

_DELIMITERS = ";\t,"
_IN_BRACKETS = re.compile(r"[\[(]([^\[\]()]+)[\])]$")
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
            return (_read_mat(path), {}) if suffix == ".mat" else _read_csv(path)
        except (ValueError, csv.Error) as error:
            raise ConfigError(f"{path}: is no recording: {printable(str(error))}") from None


def as_recording(columns: Columns, units: Units) -> Recording:
    """Return a table of another tool as a recording, in its own units.

    The time is the first column that is called time, t or Zeit, else the first of all. Brackets
    with the unit are no part of a name, and two columns of one name are a `ConfigError`.

    Args:
        columns: of the table, as `read_columns` returns them.
        units: likewise.
    """
    names = {column: _IN_BRACKETS.sub("", column).strip() for column in columns}
    called = (column for column, name in names.items() if name.casefold() in _TIMES)
    time = next(called, next(iter(columns)))
    names = {time: TIME.name} | {column: names[column] for column in columns if column != time}
    channels = [Channel(name, units.get(column, "")) for column, name in names.items()]
    recording = np.empty(len(columns[time]), dtype=recording_dtype(channels))
    for column, name in names.items():
        recording[name] = columns[column]
    return recording


def _read_lines(path: Path) -> tuple[list[str], str]:
    """Return the lines of a table that have their ends, and its delimiter."""
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    lines = text.splitlines()
    if text[-1:] not in {"", "\n", "\r"}:
        lines.pop()  # its writer may have been killed within a number
    return lines, max(_DELIMITERS, key=lambda one: sum(one in line for line in lines[:_HEAD]))


def _read_head(lines: list[str], delimiter: str) -> tuple[list[list[str]], int, int]:
    """Return the rows above the first row of numbers, the line of that, and its fields.

    Raises:
        ConfigError: there is no row of numbers.
    """
    reader, line = csv.reader(lines, delimiter=delimiter), 0
    heads: list[list[str]] = []
    for row in reader:
        if row and _is_numeric(row, delimiter):
            return heads, line, len(row)
        if row:
            heads.append(row)
        line = reader.line_num
    raise ConfigError("it has no row of numbers")


def _named_rows(above: list[list[str]], width: int) -> list[list[str]]:
    """Return the rows above the numbers that are as wide as these, and not empty."""
    rows = [[field.strip() for field in row] for row in above if len(row) == width]
    return [row for row in rows if any(row)]


def _read_csv(path: Path) -> tuple[Columns, Units]:
    lines, delimiter = _read_lines(path)
    above, first, width = _read_head(lines, delimiter)
    heads = _named_rows(above, width)
    if not heads:
        raise ConfigError(f"its {width} columns have no names; give a row of names")
    names, *below = heads
    if twice := {name for name in names if name and names.count(name) > 1}:
        raise ConfigError(f"it has the column {min(twice)} twice")
    try:
        values = _read_quickly(lines[first:], delimiter, width)
    except ValueError:
        values = _read_slowly(lines[first:], delimiter, len(above))
    units = dict(zip(names, below[0] if below else (), strict=False))
    units |= {name: found[1] for name in names if (found := _IN_BRACKETS.search(name))}
    return {name: values[:, number] for number, name in enumerate(names) if name}, units


def _read_quickly(lines: list[str], delimiter: str, width: int) -> Values:
    """Return the numbers of a table.

    Raises:
        ValueError: it has other fields, or rows of another length.
    """
    if lines[-1].count(delimiter) < width - 1:
        lines = lines[:-1]  # its writer was killed
    if delimiter != ",":
        lines = [line.replace(",", ".") for line in lines]
    values = np.loadtxt(lines, delimiter=delimiter, comments=None, quotechar='"', ndmin=2)
    if values.shape[1] != width:
        raise ValueError
    return values


def _read_slowly(lines: list[str], delimiter: str, above: int) -> Values:
    """Return the numbers of a table, not a number where a field is none.

    Raises:
        ConfigError: its rows differ in length.
    """
    body = [row for row in csv.reader(lines, delimiter=delimiter) if row]
    width = len(body[0])
    if len(body[-1]) < width:
        body = body[:-1]  # its writer was killed
    for number, row in enumerate(body, start=above + 1):
        if len(row) != width:
            raise ConfigError(f"row {number} has {len(row)} values, the first has {width}")
    return np.array([[_number(field, delimiter) for field in row] for row in body])


def _is_numeric(row: list[str], delimiter: str) -> bool:
    return bool(np.isfinite(_number(row[0], delimiter)))


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
