"""CSV as spreadsheets write it: with a BOM, semicolons and decimal commas, empty lines."""

import csv
import io
import re
from pathlib import Path
from typing import NamedTuple

from hil_bench.errors import ConfigError, about_file

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
