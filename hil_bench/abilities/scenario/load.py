"""Loading a scenario: `.scenario.toml`, or the same as CSV, a row a time and a column a channel."""

import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, NoReturn

from hil_bench.abilities.scenario import records
from hil_bench.abilities.scenario.reading import read_requirements, read_scenario
from hil_bench.abilities.scenario.spreadsheet import Cell, Sheet, read_cells
from hil_bench.config.document import Document, Sort, read_document
from hil_bench.config.values import find_nearest, quote
from hil_bench.errors import ConfigError

# A scenario as a table: a row a time, a column a channel; docs/scenarios.md describes it.

TIME: Final = "time_s"
LISTS: Final = ("requirement_ids", "firmware")
HEAD: Final = ("title", "bench", "duration_s", "example", *LISTS, "parameter", "expect", TIME)

_RAMP = re.compile(r"->\s*(.+?)(?:\s+over\s+(.+))?")
_TABLE = re.compile(r"table\s+(.+)")
_FAULT = re.compile(r"fault:\s*(\S+)\s+(\S+)(?:\s+(\S+))?")
_EXPECT = re.compile(r"expect:\s*(.+?)\s*(?:\+-|±)\s*(.+?)(?:\s+within\s+(.+))?")
_INTEGER = re.compile(r"[+-]?\d{1,400}")  # of more digits, Python refuses some


def read_csv_document(path: Path) -> tuple[Document, records.Spots]:
    """Return the tables of a CSV file as TOML would have them, and where each value stands.

    What is wrong raises a `ConfigError`.
    """
    table = _Table(path, read_cells(path))
    table.read()
    return table.document, table.spots


class _Table:
    """Collects the document of a sheet."""

    def __init__(self, path: Path, sheet: Sheet) -> None:
        self.document: dict[str, Any] = {"parameters": {}, "step": [], "expect": []}
        self.spots: dict[tuple[str, str], records.Spot] = {}
        self._path, self._sheet = path, sheet

    def read(self) -> None:
        """Read the head, then the rows."""
        rows = iter(self._sheet.rows)
        for row in rows:
            name = row[0].text
            if name == TIME:
                self._read_rows(row, list(rows))
                return
            if name not in HEAD:
                nearest = find_nearest(name, HEAD)
                self._fail(row[0], f"{quote(name)} is unknown; the nearest known is {nearest}")
            self._read_head(name, row)

    def _read_head(self, name: str, row: Sequence[Cell]) -> None:
        if len(row) < 2:
            self._fail(row[0], f"{name} has no value; give it in the next cell")
        texts = [cell.text for cell in row[1:]]
        spot = records.Spot(row[1].line, row[1].column)
        match name:
            case "parameter":
                self._read_parameter(row)
            case "expect":
                self._expect(texts[0], texts[1] if len(texts) > 1 else "", row[min(2, len(texts))])
            case "firmware" | "example":
                value = texts if name == "firmware" else texts[0]
                self.document.setdefault("controller", {})[name] = value
                self.spots["controller", name] = spot
            case _:
                self.document[name] = texts if name in LISTS else self._scalar(texts[0], name)
                self.spots["", name] = spot

    def _read_parameter(self, row: Sequence[Cell]) -> None:
        if len(row) not in {3, 5}:
            self._fail(row[0], "give parameter, name, value, and where it varies lowest, highest")
        name, *numbers = (cell.text for cell in row[1:])
        values = [self._value(number) for number in numbers]
        self.document["parameters"][name] = {"value": values[0]}
        if len(values) == 3:
            self.document["parameters"][name]["range"] = values[1:]
        self.spots[f"parameters.{name}", ""] = records.Spot(row[2].line, row[2].column)

    def _scalar(self, text: str, name: str) -> object:
        return self._value(text) if name == "duration_s" else text

    def _expect(self, name: str, that: str, cell: Cell) -> None:
        self.document["expect"].append({"id": name, "that": that})
        spot = records.Spot(cell.line, cell.column)
        number = len(self.document["expect"])
        self.spots[f"expect[{number}]", "that"] = self.spots[f"expect[{number}]", ""] = spot

    def _read_rows(self, names: Sequence[Cell], rows: Sequence[Sequence[Cell]]) -> None:
        readers = [self._column(cell) for cell in names[1:]]
        for number, row in enumerate(rows):
            if not row[0].text:
                self._fail(row[0], f"has no time; give it in the column {TIME}")
            if len(row) > len(names):
                self._fail(row[len(names)], "has no column name above it; give it one")
            later = rows[number + 1][0] if number + 1 < len(rows) else None
            for cell, read in zip(row[1:], readers, strict=False):
                if cell.text:
                    read(row[0], cell, later)

    def _column(self, head: Cell) -> Callable[[Cell, Cell, Cell | None], None]:
        """Return the reader of a column's cells."""
        name = head.text
        if name.startswith("fault:"):
            match = _FAULT.fullmatch(name)
            if match is None:
                self._fail(head, "give fault:KIND TARGET, as in fault:drop_supply axis1")
            kind, target, key = match.groups()
            return lambda at, cell, _: self._step(
                at, cell, {"fault": kind, "target": target} | self._fault_values(cell, key)
            )
        if name.startswith("nmt:"):
            node = name.removeprefix("nmt:").strip()
            return lambda at, cell, _: self._step(at, cell, {"nmt": cell.text, "target": node})
        if name.startswith("expect:"):
            return self._expect_column(head)
        if name == "sync":
            return lambda at, cell, _: self._step(at, cell, {"sync": self._switch(cell)})
        if name.startswith("firmware"):
            target = name.removeprefix("firmware").removeprefix(":").strip()
            given: dict[str, object] = {"target": target} if target else {}
            return lambda at, cell, _: self._step(at, cell, {"firmware": cell.text} | given)
        return lambda at, cell, later: self._step(at, cell, self._set(name, at, cell, later))

    def _expect_column(self, head: Cell) -> Callable[[Cell, Cell, Cell | None], None]:
        match = _EXPECT.fullmatch(head.text)
        if match is None:
            right = "expect:axis1.position +- 1 mm within 200 ms"
            self._fail(head, f"is no expectation; give it as in {right}")
        signal, tolerance, window = match.groups()

        def read(at: Cell, cell: Cell, _later: Cell | None) -> None:
            start = self._sheet.number(at.text)
            if start is None:
                self._fail(at, f"{quote(at.text)} is no number, which expect: needs; give one")
            when = f"from {start:.9g} s to {start:.9g} s"
            inside = f"abs({signal} - {cell.text}) <= {tolerance}"
            ahead = f"within {window} {inside}" if window else inside
            self._expect(f"{signal} at {start:.9g} s", f"always {when} {ahead}", cell)

        return read

    def _set(self, name: str, at: Cell, cell: Cell, later: Cell | None) -> dict[str, object]:
        if match := _TABLE.fullmatch(cell.text):
            return {"set": name, "table": match[1]}
        match = _RAMP.fullmatch(cell.text)
        if match is None:
            return {"set": {name: self._value(cell.text)}}
        over = self._value(match[2]) if match[2] else self._until(at, cell, later)
        return {"set": {name: self._value(match[1])}, "over_s": over}

    def _until(self, at: Cell, cell: Cell, later: Cell | None) -> float:
        start = self._sheet.number(at.text)
        end = self._sheet.number(later.text) if later else None
        if start is None or end is None or end <= start:
            wrong = "ramps to the next row, and there is none with a later time"
            self._fail(cell, f'{wrong}; write it as in "-> 0.4 over 0.2"')
        return round(end - start, 9)

    def _fault_values(self, cell: Cell, key: str | None) -> dict[str, object]:
        if cell.text == "on":
            return {}
        if "=" not in cell.text and key:
            return {key: self._value(cell.text)}
        pairs = [word.partition("=") for word in cell.text.split()]
        if not all(sign for _, sign, _ in pairs):
            self._fail(cell, 'give on, or keys as in "pressure_bar=60 for_s=0.5"')
        return {name: self._value(value) for name, _, value in pairs}

    def _switch(self, cell: Cell) -> bool:
        if cell.text not in {"on", "off"}:
            self._fail(cell, f"{quote(cell.text)} is neither on nor off; give one of them")
        return cell.text == "on"

    def _step(self, at: Cell, cell: Cell, values: dict[str, object]) -> None:
        self.document["step"].append({"at_s": self._value(at.text), **values})
        table = f"step[{len(self.document['step'])}]"
        self.spots[table, ""] = records.Spot(cell.line, cell.column)
        self.spots[table, "at_s"] = records.Spot(at.line, at.column)

    def _value(self, text: str) -> object:
        if _INTEGER.fullmatch(text):
            return int(text)
        number = self._sheet.number(text)
        return text if number is None else number

    def _fail(self, cell: Cell, what: str) -> NoReturn:
        """End the reading.

        Raises:
            ConfigError: always.
        """
        raise ConfigError(f"{self._path}:{cell.line}:{cell.column}: {what}")


# Loading a scenario: `.scenario.toml`, or the same as CSV.


def load_scenario(path: str | os.PathLike[str]) -> records.Scenario:
    """Return the scenario of a file, by its suffix CSV or TOML.

    Whatever is wrong comes as one `ConfigError`, a line a problem: ``file:line:column: key: what
    is wrong; what would be right``. The expectations are parsed by `compile_expectations`, which
    knows the signals.
    """
    file = Path(path)
    document, problems = _read(file)
    return read_scenario(file, document, problems)


def load_requirements(path: str | os.PathLike[str]) -> records.RequirementsFile:
    """Return the requirements of a file.

    The file is a scenario, or holds nothing but ``duration_s``, ``[[expect]]`` and
    ``[parameters]``.
    """
    file = Path(path)
    document, problems = _read(file)
    return read_requirements(file, document, problems)


def _read(file: Path) -> tuple[Document, records.LocatedProblems]:
    if file.suffix.lower() == ".csv":
        document, spots = read_csv_document(file)
    else:
        document = read_document(file, Sort.SCENARIO)
        spots = records.find_spots(file.read_text(encoding="utf-8-sig"))
    return document, records.LocatedProblems(str(file), spots)
