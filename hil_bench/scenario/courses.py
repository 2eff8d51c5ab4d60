"""A course of many points: a CSV file of times and values, from a spreadsheet or a recording."""

import math
from pathlib import Path

from hil_bench.errors import ConfigError
from hil_bench.scenario.spreadsheet import Cell, read_cells

Course = tuple[tuple[float, float], ...]
_MOST_POINTS = 1_000_000


def read_course(path: Path) -> Course:
    """Return times [s] and values of a file with two columns; a row of names may come first.

    Raises:
        ConfigError: the file cannot be read, or is no course.
    """
    sheet = read_cells(path)
    rows = sheet.rows
    if rows and sheet.number(rows[0][0].text) is None:
        rows = rows[1:]
    if not 1 <= len(rows) <= _MOST_POINTS:
        raise ConfigError(f"{path}: has {len(rows)} points; give 1 to {_MOST_POINTS}")
    points: list[tuple[float, float]] = []
    for row in rows:
        if len(row) != 2:
            raise ConfigError(f"{path}:{row[0].line}: has {len(row)} cells; give time_s and value")
        time, value = (_number(path, sheet.number(cell.text), cell) for cell in row)
        if time < 0 or (points and time <= points[-1][0]):
            raise ConfigError(f"{path}:{row[0].line}: time does not go on; give rising times")
        points.append((time, value))
    return tuple(points)


def _number(path: Path, value: float | None, cell: Cell) -> float:
    """Return the number of a cell.

    Raises:
        ConfigError: it holds none.
    """
    if value is None or not math.isfinite(value):
        place = f"{path}:{cell.line}:{cell.column}"
        raise ConfigError(f"{place}: {cell.text[:20]!r} is no number; give one such as 0.5")
    return value
