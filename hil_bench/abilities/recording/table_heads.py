"""Heads of tables: where loggers and oscilloscopes have the names, units and times of columns.

Most have a row of names, and one of units below it. Read as their makers write them are

- LVM of LabVIEW: units and times stand between two lines ``***End_of_Header***``
- CSV of Rigol's oscilloscopes that number the samples: the first time and the step between two
  stand behind the names and the units
- CSV of Tektronix' TDS: the settings have the first columns of the rows, time and value the next
- CSV of TwinCAT's Scope: the names are followed by rows of settings, each with its key in front
"""

import csv
import re
import sys
from collections.abc import Sequence
from itertools import pairwise, zip_longest
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil_bench.errors import ConfigError
from hil_bench.units import bare_unit, read_unit

Rows = list[list[str]]
Values = npt.NDArray[np.float64]

END_OF_HEAD = "***End_of_Header***"
"""The line of LabVIEW's LVM files above their names, and one further up."""

IN_BRACKETS = re.compile(r"[\[(]([^\[\]()]+)[\])]$")

_SIGNALS = ("a", "ma", "ua", "v", "mv", "uv", "kv", "volt", "volts", "count", "counts", "lsb")
RAW_UNITS = frozenset((*_SIGNALS, "sequence", "sample", "samples"))
"""Units of what no gain has made a quantity of, in small letters."""

_ONE_TIME = "write it with a column of time, X_Columns One"
_RIGOL_CLOCK = ["Start", "Increment"]
_RIGOL_NUMBERS = "Sequence"
_NUMBER = re.compile(r"[+-]?\d*[.,]?\d+(?:[eE][+-]?\d+)?")
_TEKTRONIX = "Record Length"
_TWINCAT = "SampleTime[ms]"


class Clock(NamedTuple):
    """The times of rows that have none.

    Attributes:
        start: of the first row, or of the row with the number 0 [s].
        step: from one row to the next [s].
        column: number of the column that numbers the rows, or stands for the time and is empty.
        is_numbered: whether that column numbers the rows.
        most: rows up to which that holds.
    """

    start: float
    step: float
    column: int | None = None
    is_numbered: bool = False
    most: int = sys.maxsize


class Head(NamedTuple):
    """The names of a table's columns and what else its head says of them.

    Attributes:
        names: of each column; empty where it has none.
        units: of the first of them.
        clock: of rows without a time.
        has_remarks: whether rows may have words behind the columns.
    """

    names: list[str]
    units: list[str]
    clock: Clock | None = None
    has_remarks: bool = False


def plain_lines(lines: list[str]) -> list[str]:
    """Return the lines of a table, those of a Tektronix TDS without the settings beside them."""
    if not lines or not lines[0].startswith(f"{_TEKTRONIX},"):
        return lines
    rows = [row for row in csv.reader(lines) if len(row) > 4]
    if not rows or not rows[0][3].strip():
        return lines
    settings = {row[0]: row[1] for row in rows if row[0]}
    heads = [
        f"time,{settings.get('Source', 'CH1')}",
        f"{settings.get('Horizontal Units', '')},{settings.get('Vertical Units', '')}",
    ]
    return heads + [f"{row[3]},{row[4]}" for row in rows]


def read_head(above: Rows, first: Sequence[str]) -> Head:
    """Return the head of a table; a `ConfigError` where it has no names.

    Args:
        above: the rows above the first one of numbers.
        first: that one.
    """
    above = [[field.strip() for field in row] for row in above if any(map(str.strip, row))]
    ends = [number for number, row in enumerate(above) if row[0] == END_OF_HEAD]
    if ends and above[ends[-1] + 1 :]:
        return _read_labview(above[: ends[-1]], above[ends[-1] + 1])
    for names, units in pairwise(map(_without_end, above)):
        if names[-2:] == _RIGOL_CLOCK and all(map(_NUMBER.fullmatch, units[-2:])):
            return _read_rigol(names[:-2], units)
    if {"Name", _TWINCAT} <= {row[0] for row in above}:
        return _read_twincat(above)
    return _read_rows(above, first)


def _read_labview(settings: Rows, names: list[str]) -> Head:
    said = {row[0]: row[1:] for row in settings}
    names = names[:-1] if names[-1] == "Comment" else names
    labels = ["", *said.get("Y_Unit_Label", [])]
    is_time = said.get("X_Dimension", ["Time"])[0] == "Time"
    units = [
        "s" if name == "X_Value" and is_time else label
        for name, label in zip(names, labels + [""] * len(names), strict=False)
    ]
    if said.get("X_Columns", [])[:1] != ["No"] or not is_time:
        return Head(names, units, has_remarks=True)
    clocks = [said.get(key, [])[: len(names) - 1] for key in ("X0", "Delta_X", "Samples")]
    if any(len(set(each)) != 1 for each in clocks):
        raise ConfigError(f"its channels differ in X0, Delta_X or Samples; {_ONE_TIME}")
    start, step, most = (_number(each[0]) for each in clocks)
    clock = Clock(start, step, column=0, most=int(most))
    return Head(names, units, clock, has_remarks=True)


def _read_rigol(names: list[str], units: list[str]) -> Head:
    start, step = map(_number, units[-2:])
    clock = Clock(start, step)
    if units[0] == _RIGOL_NUMBERS:
        clock = clock._replace(column=0, is_numbered=True)
    return Head(names, units[:-2], clock)


def _read_twincat(above: Rows) -> Head:
    said = {row[0]: row for row in above}
    names, units = said.get("Name", []), said.get("Unit", [])
    pairs = zip_longest(names, units[: len(names)], fillvalue="")
    return Head(
        names,
        ["ms" if name == "Name" else unit.partition("(")[0].strip() for name, unit in pairs],
    )


def _read_rows(above: Rows, first: Sequence[str]) -> Head:
    width = len(first)
    while not first[width - 1].strip() and not any(any(row[width - 1 :]) for row in above):
        width -= 1
    fitting = [row[:width] for row in above if len(row) >= width and not any(row[width:])]
    fitting = [row for row in fitting if any(row)]
    if not fitting:
        raise ConfigError(
            f"its {width} columns have no names; give a row of {width} names above the numbers, "
            "as in time [s],P_A [bar]"
        )
    names, units = fitting[0], fitting[1] if fitting[1:] else []
    named = fitting[:-1] if fitting[-1] == above[-1][:width] else fitting
    if named and _are_units(above[-1]):
        names, units = named[-1], above[-1]
    elif any(map(IN_BRACKETS.search, fitting[-1])):
        names, units = fitting[-1], []
    is_time = (unit := read_unit(units[0] if units else "")) is not None and unit.symbol == "s"
    units = [found[1] if (found := IN_BRACKETS.fullmatch(unit)) else unit for unit in units]
    return Head([names[0] or "time" * is_time, *names[1:]], units)


def _are_units(row: list[str]) -> bool:
    return any(map(read_unit, row)) and all(
        not field
        or IN_BRACKETS.fullmatch(field)
        or read_unit(field)
        or bare_unit(field).casefold() in RAW_UNITS
        for field in row
    )


def times_of(clock: Clock, rows: Values) -> Values:
    """Return the times of rows that have none [s].

    Raises:
        ConfigError: the head gives those of fewer rows.
    """
    if len(rows) > clock.most:
        raise ConfigError(
            f"it has {len(rows)} rows without a time, and its head has Samples {clock.most}: when "
            f"the others begin is not said; {_ONE_TIME}"
        )
    is_counted = clock.is_numbered and clock.column is not None
    numbers = rows[:, clock.column] if is_counted else np.arange(len(rows), dtype=np.float64)
    return clock.start + clock.step * numbers


def _without_end(row: list[str]) -> list[str]:
    """Return a row less the empty fields at its end."""
    width = max((number for number, field in enumerate(row, 1) if field), default=0)
    return row[:width]


def _number(text: str) -> float:
    return float(text.replace(",", "."))
