"""The records of a scenario, and their places in its file."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple

from hil_bench.abilities.controllers.power import Power
from hil_bench.abilities.scenario.dimensions import unit_of_name
from hil_bench.config.settings import Problems, quote_name
from hil_bench.units import Unit

# A scenario: what is done to a bench and when, and what is expected of it.
#
# The records hold what the file says, in the units of its keys. A number may be the name of a
# parameter. `hil_bench.abilities.scenario.resolve` puts the numbers in and turns times into ticks.


class Reference(NamedTuple):
    """The name of a parameter, in the place of a number."""

    name: str


Amount = float | Reference
"""A number, or the parameter that holds it."""


def ticks_of(duration: float, tick_ns: int) -> int:
    """Return the number of ticks of a run: that at its beginning, and all up to its end.

    Args:
        duration: of the run [s].
        tick_ns: time between two ticks [ns].
    """
    return round(duration * 1e9) // tick_ns + 1


class NmtVerb(StrEnum):
    """A command of an NMT master to a node (CiA 301)."""

    START = "start"
    STOP = "stop"
    PRE_OPERATIONAL = "pre_operational"
    RESET_NODE = "reset_node"
    RESET_COMMUNICATION = "reset_communication"


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number with a name, which ends in its unit.

    Attributes:
        name: as in ``target_mm``.
        value: what it is unless a run says otherwise.
        span: lowest and highest value for campaigns; None for a constant.
    """

    name: str
    value: float
    span: tuple[float, float] | None = None

    @property
    def unit(self) -> Unit:
        """Its unit."""
        return unit_of_name(self.name).unit


@dataclass(frozen=True, slots=True)
class SetStep:
    """A signal of the controller's side, a load, an object or a register gets a value.

    Attributes:
        at: when [s].
        target: its name.
        value: in SI, or as the object has it; the last one of a course.
        over: time of the ramp to the value [s]; 0 for at once.
        table: the file of a course of many points; empty for none.
        points: that course: time after `at` [s] and value.
        unit: symbol of the unit in which the value was given; empty for a bare number.
        place: how messages name the step: file, line and column; so of all kinds of steps.
    """

    at: Amount
    target: str
    value: Amount
    over: Amount = 0.0
    table: str = ""
    points: tuple[tuple[float, Amount], ...] = ()
    unit: str = field(default="", compare=False)
    place: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class FaultStep:
    """A fault of docs/faults.md.

    Attributes:
        at: when [s].
        kind: as in ``drop_supply``.
        target: what has it.
        values: the other keys with their values, sorted, as `[[faults]]` has them.
    """

    at: Amount
    kind: str
    target: str
    values: tuple[tuple[str, object], ...] = ()
    place: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class NmtStep:
    """An NMT command to a node; ``all`` is every node."""

    at: Amount
    command: NmtVerb
    target: str
    place: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class SyncStep:
    """The controller's SYNC goes on or off."""

    at: Amount
    is_on: bool
    place: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class FirmwareStep:
    """A controller is started, killed or both: the named one, or the only one."""

    at: Amount
    command: Power
    target: str = ""
    place: str = field(default="", compare=False)


Step = SetStep | FaultStep | NmtStep | SyncStep | FirmwareStep


@dataclass(frozen=True, slots=True)
class Controller:
    """The controller that drives the bench.

    Attributes:
        firmware: a command line; ``{bus}`` and names of parameters stand for their values.
        example: the name of a controller of the package; empty for none.
        table: the whole table of a controller of another kind, with its ``kind``; empty for none.
    """

    firmware: tuple[str, ...] = ()
    example: str = ""
    table: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Expectation:
    """An expectation of a scenario.

    Attributes:
        id: of the requirement.
        that: in the language of docs/expectations.md.
        place: how messages name its text: file, line and column.
    """

    id: str
    that: str
    place: "TextPlace" = field(default_factory=lambda: TextPlace("", 1, 1), compare=False)


class TextPlace(NamedTuple):
    """The place of a text in a file.

    Attributes:
        source: the file.
        line: of its first character, from 1.
        column: likewise.
    """

    source: str
    line: int
    column: int

    def at(self, line: int, column: int) -> str:
        """Return the place of a character of the text, as a message begins with it."""
        shift = self.column - 1 if line == 1 else 0
        return f"{self.source}:{self.line + line - 1}:{column + shift}"


def unjudged_ids(named: Iterable[str], judged: Iterable[str]) -> list[str]:
    """List the requirements that a file is about and that have no verdict."""
    ids = {*judged}
    return [one for one in dict.fromkeys(named) if one not in ids]


class RequirementsFile(NamedTuple):
    """The requirements of a file, for any run.

    Attributes:
        path: the file.
        expectations: one or more.
        parameters: in the order of the file.
        duration: of the run of which they speak [s]; None where the file does not say it.
        faults: kind and target of the faults of that run, as in ``drop_supply axis1``.
        requirement_ids: the requirements that it is about.
    """

    path: Path
    expectations: tuple[Expectation, ...]
    parameters: tuple[Parameter, ...]
    duration: float | None
    faults: tuple[str, ...]
    requirement_ids: tuple[str, ...]

    @property
    def unjudged(self) -> list[str]:
        """The requirements that it is about and that no expectation is on."""
        return unjudged_ids(self.requirement_ids, (each.id for each in self.expectations))


@dataclass(frozen=True, slots=True)
class Scenario:
    """A whole scenario.

    Attributes:
        path: its file; it names other files from there.
        title: in words.
        bench: the file of the bench; None for the built-in one.
        duration: how long it runs [s].
        requirement_ids: the requirements that it is about.
        controller: who drives; None for the steps alone.
        parameters: in the order of the file.
        steps: in the order of the file.
        expectations: one or more.
    """

    path: Path = field(compare=False)
    title: str
    bench: str | None
    duration: float
    requirement_ids: tuple[str, ...]
    controller: Controller | None
    parameters: tuple[Parameter, ...]
    steps: tuple[Step, ...]
    expectations: tuple[Expectation, ...]

    @property
    def bench_path(self) -> Path | None:
        """The file of the bench as seen from here; None for the built-in one."""
        return self.path.parent / self.bench if self.bench else None

    @property
    def unjudged(self) -> list[str]:
        """The requirements that it is about and that no expectation is on."""
        return unjudged_ids(self.requirement_ids, (each.id for each in self.expectations))


# The place of a key in a file: line and column, which the TOML parser does not give.


_HEADER = re.compile(r"\s*(\[\[?)\s*([^\]]+?)\s*\]\]?\s*(#.*)?$")
_KEY = re.compile(r"""\s*("[^"]*"|'[^']*'|[\w-]+(?:\.[\w-]+)*)\s*=\s*""")
_QUOTES = ('"""', "'''")


class Spot(NamedTuple):
    """A line and a column, both from 1."""

    line: int
    column: int


Spots = Mapping[tuple[str, str], Spot]
"""Of the value of each key, by table and key."""


class LocatedProblems(Problems):
    """Problems whose places begin with file, line and column.

    Args:
        source: the file.
        spots: where its keys stand.
    """

    def __init__(self, source: str, spots: Spots) -> None:
        super().__init__(source)
        self.spots = spots

    def place(self, table: str, key: str = "") -> str:
        """Return file, line, column and name of a key; of its table where the key is missing."""
        name = ".".join(quote_name(part) for part in (table, key) if part)
        spot = self.find(table, key)
        where = f"{self.source}:{spot.line}:{spot.column}" if spot else self.source
        return f"{where}: {name}" if name else where

    def find(self, table: str, key: str) -> Spot | None:
        """Return the place of a key, else of the part around it; None where it is unknown."""
        parent, _, name = table.rpartition(".")
        for wanted in ((table, key), (table, ""), (parent, name), ("", table)):
            if wanted in self.spots:
                return self.spots[wanted]
        return None


def find_spots(text: str) -> Spots:
    """Return the places of all keys and tables of a TOML text."""
    spots: dict[tuple[str, str], Spot] = {}
    counts: dict[str, int] = {}
    table, quotes = "", ""
    for number, line in enumerate(text.splitlines(), 1):
        if quotes:
            quotes = "" if quotes in line else quotes
        elif header := _HEADER.match(line):
            table = _name(header[2], counts) if header[1] == "[[" else header[2]
            spots[table, ""] = Spot(number, header.start(2) + 1)
        elif key := _KEY.match(line):
            name = key[1].strip("\"'")
            spots.setdefault((table, name), _value_spot(number, key.end(), line))
            quotes = _open_quotes(line[key.end() :])
    return spots


def _name(table: str, counts: dict[str, int]) -> str:
    counts[table] = counts.get(table, 0) + 1
    return f"{table}[{counts[table]}]"


def _value_spot(number: int, start: int, line: str) -> Spot:
    """Return the place of a value's text: behind its quotes."""
    rest = line[start:]
    for quotes in (*_QUOTES, '"', "'"):
        if rest.startswith(quotes):
            start += len(quotes)
            return Spot(number + 1, 1) if start == len(line) else Spot(number, start + 1)
    return Spot(number, start + 1)


def _open_quotes(rest: str) -> str:
    for quotes in _QUOTES:
        if rest.count(quotes) % 2:
            return quotes
    return ""
