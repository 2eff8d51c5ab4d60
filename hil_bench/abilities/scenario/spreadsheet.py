"""CSV as spreadsheets write it, and a course of many points in one."""

import csv
import io
import math
import re
from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple

from hil_bench.abilities.recording.foreign_tables import check_marks
from hil_bench.abilities.scenario.records import Amount, Reference
from hil_bench.errors import ConfigError, about_file

# CSV as spreadsheets write it: with a BOM, semicolons and decimal commas, empty lines.

_FIRST_WORD = re.compile(r'\s*"?[A-Za-z_]+"?\s*([;,])')


class Cell(NamedTuple):
    """A cell that is not empty, or stands before one.

    Attributes:
        text: without spaces around it.
        line: of the file, from 1.
        column: in that line, from 1.
    """

    text: str
    line: int
    column: int


class Sheet(NamedTuple):
    """A table of texts.

    Attributes:
        rows: without empty ones, and each without empty cells at its end.
        has_commas: whether decimals have a comma: then semicolons separate the cells.
    """

    rows: list[list[Cell]]
    has_commas: bool

    def number(self, text: str) -> float | None:
        """Return the number that a text is, None for no number."""
        try:
            return float(text.replace(",", ".", 1) if self.has_commas else text)
        except ValueError:
            return None


def read_cells(path: Path) -> Sheet:
    """Return the cells of a CSV file.

    Raises:
        ConfigError: it cannot be read.
    """
    with about_file(path, what="cannot be read", right="give a CSV file"):
        content = path.read_bytes()
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: is not UTF-8 text; save it as CSV UTF-8") from None
    lines = text.splitlines()
    has_commas = _is_separated_by_semicolons(next((line for line in lines if line.strip()), ""))
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=";" if has_commas else ",")
    rows = []
    try:
        for row in reader:
            cells = _place(row, lines[reader.line_num - 1], reader.line_num)
            while cells and not cells[-1].text:
                cells.pop()
            if cells:
                rows.append(cells)
    except csv.Error as error:
        where = f"{path}:{reader.line_num}"
        raise ConfigError(f"{where}: is no CSV: {error}; save it anew") from None
    if has_commas:
        check_marks(
            (f"{path}:{each.line}:{each.column}", each.text) for row in rows for each in row
        )
    return Sheet(rows, has_commas)


def _is_separated_by_semicolons(line: str) -> bool:
    """Return True if the first line has a semicolon: behind its first word, else anywhere."""
    word = _FIRST_WORD.match(line)
    return word[1] == ";" if word else ";" in line


def _place(row: list[str], line: str, number: int) -> list[Cell]:
    """Return cells with the column in which each begins."""
    cells, position = [], 0
    for each in row:
        text = each.strip()
        position = max(position, line.find(text.replace('"', '""'), position))
        cells.append(Cell(text, number, position + 1))
        position += len(text)
    return cells


# A course of many points: a CSV file of times and values, from a spreadsheet or a recording.

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
