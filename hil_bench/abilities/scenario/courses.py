"""A course of many points: a CSV file of times and values, from a spreadsheet or a recording."""

import math
from collections.abc import Collection
from pathlib import Path

from hil_bench.abilities.scenario.records import Amount, Reference
from hil_bench.abilities.scenario.spreadsheet import Cell, read_cells
from hil_bench.errors import ConfigError

Course = tuple[tuple[float, Amount], ...]
_MOST_POINTS = 1_000_000


def read_course(path: Path, parameters: Collection[str] = ()) -> Course:
    """Return times [s] and values of a file with two columns; a row of names may come first.

    Args:
        path: of the file.
        parameters: names that may stand in the place of values.

    Raises:
        ConfigError: the file cannot be read, or is no course.
    """
    sheet = read_cells(path)
    rows = sheet.rows
    if rows and sheet.number(rows[0][0].text) is None:
        rows = rows[1:]
    if not 1 <= len(rows) <= _MOST_POINTS:
        raise ConfigError(f"{path}: has {len(rows)} points; give 1 to {_MOST_POINTS}")
    points: list[tuple[float, Amount]] = []
    for row in rows:
        if len(row) != 2:
            raise ConfigError(f"{path}:{row[0].line}: has {len(row)} cells; give time_s and value")
        time = _number(path, sheet.number(row[0].text), row[0])
        name = row[1].text.strip()
        value: Amount = (
            Reference(name)
            if name in parameters
            else _number(path, sheet.number(row[1].text), row[1], parameters)
        )
        if time < 0 or (points and time <= points[-1][0]):
            raise ConfigError(f"{path}:{row[0].line}: time does not go on; give rising times")
        points.append((time, value))
    return tuple(points)


def _number(path: Path, value: float | None, cell: Cell, parameters: Collection[str] = ()) -> float:
    """Return the number of a cell.

    Raises:
        ConfigError: it holds none.
    """
    if value is None or not math.isfinite(value):
        place = f"{path}:{cell.line}:{cell.column}"
        known = f" or one of {', '.join(parameters)}" if parameters else ""
        raise ConfigError(f"{place}: {cell.text[:20]!r} is no number; give one such as 0.5{known}")
    return value
