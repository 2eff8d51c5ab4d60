"""The tables of a scenario, of whichever file, to records."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from hil_bench.abilities.controllers.kinds import find_kind
from hil_bench.abilities.controllers.power import Power
from hil_bench.abilities.faults.kind import FaultKind
from hil_bench.abilities.faults.registry import COMMON_KEYS, find_fault_kind, kind_name
from hil_bench.abilities.scenario import records
from hil_bench.abilities.scenario.dimensions import unit_of_name
from hil_bench.abilities.scenario.parse import parse_quantity
from hil_bench.abilities.scenario.records import NmtVerb
from hil_bench.abilities.scenario.spreadsheet import read_course
from hil_bench.abilities.scenario.syntax import ExpectationError
from hil_bench.config.document import Document, Tables, check_tables, read_section
from hil_bench.config.settings import Key, Problems, Settings, read_table
from hil_bench.config.values import (
    NoNumberError,
    Value,
    boolean,
    choice,
    describe,
    find_nearest,
    number,
    quote,
    text,
    texts,
)
from hil_bench.errors import ConfigError
from hil_bench.units import SECOND

# The keys of a scenario file: name, unit, default; docs/scenarios.md says what each means.

LONGEST_RUN = 1e6  # [s]


def span(value: object) -> tuple[float, float]:
    """Return lowest and highest value.

    Raises:
        ConfigError: the value is something else.
    """
    if not isinstance(value, list) or len(value) != 2:
        raise ConfigError(f"{describe(value)} is not a range; give [lowest, highest]")
    low, high = (number()(bound) for bound in value)
    if low >= high:
        raise ConfigError(f"[{low:g}, {high:g}] is empty; give [lowest, highest]")
    return low, high


def values_by_name(value: object) -> Mapping[str, object]:
    """Return a table of one or more values.

    Raises:
        ConfigError: the value is something else.
    """
    if not isinstance(value, dict) or not value:
        right = 'write it as set = { "valve.spool_setpoint" = 0.4 }'
        raise ConfigError(f"{describe(value)} is not a table of values; {right}")
    return value


DURATION_KEY: Final = Key(
    "duration_s", number(SECOND, low=1e-3, high=LONGEST_RUN), None, SECOND, example="6.0"
)
_IDS_KEY: Final = Key("requirement_ids", texts, ())
HEAD_KEYS: Final = (
    Key("title", text, example='"Extends 100 mm"'),
    Key("bench", text),
    DURATION_KEY,
    _IDS_KEY,
)
CONTROLLER_KEYS: Final = (Key("firmware", texts, ()), Key("example", text, ""))
PARAMETER_KEYS: Final = (Key("value", number(), example="100.0"), Key("range", span))
EXPECT_KEYS: Final = (
    Key("id", text, example='"SRS-41"'),
    Key("that", text, example='"always axis1.P_A < 250 bar"'),
)
AT_KEY: Final = Key("at_s", number(SECOND, low=0.0, high=LONGEST_RUN), None, SECOND, example="0.5")

_SET_KEYS: Final = (
    Key("set", values_by_name),
    Key("over_s", number(SECOND, low=0.0, high=LONGEST_RUN), 0.0, SECOND),
)
_TABLE_KEYS: Final = (Key("set", text), Key("table", text, example='"profile.csv"'))
_TARGET_KEY: Final = Key("target", text, example='"valve"')

STEP_KEYS: Final[Mapping[str, tuple[Key, ...]]] = MappingProxyType(
    {
        "set": (AT_KEY, *_SET_KEYS),
        "table": (AT_KEY, *_TABLE_KEYS),
        "nmt": (AT_KEY, Key("nmt", choice(NmtVerb)), _TARGET_KEY),
        "sync": (AT_KEY, Key("sync", boolean)),
        "firmware": (AT_KEY, Key("firmware", choice(Power)), Key("target", text, "")),
    }
)
"""The keys of each kind of step but a fault; the kind is one of its keys."""

STEP_KINDS: Final = ("set", "fault", "nmt", "sync", "firmware")


def fault_step_keys(kind: FaultKind) -> tuple[Key, ...]:
    """Return the keys of a step that is a fault."""
    common = {key.name: key for key in COMMON_KEYS}
    named = Key("fault", kind_name)
    return (AT_KEY, named, common["target"], common["for_s"], *kind.keys)


# The tables to records.

_TABLES = ("controller", "parameters", "step", "expect")


def read_scenario(
    path: Path, document: Document, problems: records.LocatedProblems
) -> records.Scenario:
    """Return the scenario of a document; every problem is told at once, a line each.

    Args:
        path: its file.
        document: the tables, as TOML has them.
        problems: to be noted.
    """
    file = Tables(document, problems)
    settings = file.head(HEAD_KEYS, _TABLES)
    parameters = _read_parameters(document, problems)
    reader = StepReader(path.parent, parameters, problems)
    steps = [step for table, values in file.listed("step") for step in reader.read(table, values)]
    expectations = _read_expectations(file, problems)
    controller = _read_controller(document, problems)
    if "duration_s" in settings:
        _check_times(steps, parameters, settings["duration_s"].value, reader.tables, problems)
    problems.raise_any()
    return records.Scenario(
        path,
        settings["title"].value,
        settings["bench"].value,
        settings["duration_s"].value,
        settings["requirement_ids"].value,
        controller,
        tuple(parameters.values()),
        tuple(steps),
        expectations,
    )


def read_requirements(
    path: Path, document: Document, problems: records.LocatedProblems
) -> records.RequirementsFile:
    """Return the requirements of a document.

    Args:
        path: its file.
        document: the tables; of a scenario, all else but its faults is left out.
        problems: to be noted.
    """
    check_tables(document, (*(key.name for key in HEAD_KEYS), *_TABLES), problems)
    parameters = _read_parameters(document, problems)
    file = Tables(document, problems)
    expectations = _read_expectations(file, problems)
    faults = [
        f"{step['fault']} {step.get('target', '')}"
        for _, step in file.listed("step")
        if "fault" in step
    ]
    keys = [key for key in (DURATION_KEY, _IDS_KEY) if key.name in document]
    settings = read_table("", {key.name: document[key.name] for key in keys}, keys, problems)
    problems.raise_any()
    duration, ids = (
        settings[key.name].value if key in keys else key.default for key in (DURATION_KEY, _IDS_KEY)
    )
    return records.RequirementsFile(
        path, expectations, tuple(parameters.values()), duration, tuple(dict.fromkeys(faults)), ids
    )


class StepReader:
    """Reads the tables ``[[step]]``.

    Args:
        base: the folder from which they name files.
        parameters: by name.
        problems: to be noted.

    Attributes:
        tables: the table of each step that was read, in their order.
    """

    def __init__(
        self, base: Path, parameters: Mapping[str, records.Parameter], problems: Problems
    ) -> None:
        self.tables: list[str] = []
        self._base, self._parameters, self._problems = base, parameters, problems

    def read(self, table: str, values: Mapping[str, object]) -> list[records.Step]:
        """Return the steps of a table: several, where it sets several things."""
        kinds = [kind for kind in STEP_KINDS if kind in values]
        if len(kinds) != 1:
            wrong = f"has {' and '.join(kinds)}" if kinds else "does nothing"
            self._problems.add(
                self._problems.place(table), f"{wrong}; give one of {', '.join(STEP_KINDS)}"
            )
            return []
        place = self._problems.place(table, kinds[0])
        steps = [replace(step, place=place) for step in self._read_kind(kinds[0], table, values)]
        self.tables += [table] * len(steps)
        return steps

    def _read_kind(self, kind: str, table: str, values: Mapping[str, object]) -> list[records.Step]:
        if kind == "fault":
            return self._read_fault(table, values)
        form = "table" if kind == "set" and "table" in values else kind
        found = self._settings(table, values, STEP_KEYS[form])
        if len(found) < len(STEP_KEYS[form]):
            return []
        at = found["at_s"].value
        steps: list[records.Step]
        match form:
            case "set":
                steps = self._read_set(table, found)
            case "table":
                steps = self._read_course(table, found)
            case "nmt":
                steps = [records.NmtStep(at, found["nmt"].value, found["target"].value)]
            case "sync":
                steps = [records.SyncStep(at, found["sync"].value)]
            case _:
                steps = [records.FirmwareStep(at, found["firmware"].value, found["target"].value)]
        return steps

    def _settings(self, table: str, values: Mapping[str, object], keys: Sequence[Key]) -> Settings:
        known = [key._replace(read=self._or_parameter(key)) for key in keys]
        return read_table(table, values, known, self._problems)

    def _or_parameter(self, key: Key) -> Callable[[object], Value]:
        """Return a reader that also takes the name of a parameter whose values are right."""

        def read(value: object) -> Value:
            parameter = self._parameters.get(value) if isinstance(value, str) else None
            if parameter is None:
                return self._read_plain(key, value)
            unit = unit_of_name(key.name)
            if unit.dimension != unit_of_name(parameter.name).dimension:
                right = f"give one that ends in {unit.unit.suffix or 'no unit'}"
                raise ConfigError(f"{quote(parameter.name)} has another unit; {right}")
            for each in (parameter.value, *(parameter.span or ())):
                key.read(unit.unit.from_si(parameter.unit.to_si(each)))
            return records.Reference(parameter.name)

        return read

    def _read_plain(self, key: Key, value: object) -> Value:
        try:
            return key.read(value)
        except NoNumberError:
            if isinstance(value, str) and self._parameters:
                nearest = find_nearest(value, self._parameters)
                wrong = f"{quote(value)} is no parameter; the nearest is {nearest}"
                raise ConfigError(wrong) from None
            raise

    def _read_set(self, table: str, found: Settings) -> list[records.Step]:
        steps: list[records.Step] = []
        for target, value in found["set"].value.items():
            try:
                amount, unit = self._amount(value)
            except ConfigError as error:
                place = self._problems.place(table, "set")
                self._problems.add(place, f"{quote(target)}: {error}")
            else:
                at, over = found["at_s"].value, found["over_s"].value
                steps.append(records.SetStep(at, target, amount, over, unit=unit))
        return steps

    def _amount(self, value: object) -> tuple[records.Amount, str]:
        """Return a number in SI, and the symbol of its unit; empty for a bare number.

        Raises:
            ConfigError: the value is something else.
        """
        if isinstance(value, bool | int | float):
            try:
                return float(value), ""
            except OverflowError:
                raise ConfigError(f"{describe(value)} is not finite; give a number") from None
        if isinstance(value, str) and value in self._parameters:
            return records.Reference(value), ""
        if isinstance(value, str):
            try:
                return parse_quantity(value)
            except ExpectationError:
                known = f" or one of {', '.join(self._parameters)}" if self._parameters else ""
                right = f'give a number, a text such as "5 kN"{known}'
                raise ConfigError(f"{quote(value)} is no value; {right}") from None
        raise ConfigError(f"{describe(value)} is no value; give a number")

    def _read_course(self, table: str, found: Settings) -> list[records.Step]:
        name = found["table"].value
        try:
            points = read_course(self._base / name, self._parameters)
        except ConfigError as error:
            self._problems.add(self._problems.place(table, "table"), error)
            return []
        step = records.SetStep(
            found["at_s"].value, found["set"].value, points[-1][1], table=name, points=points
        )
        return [step]

    def _read_fault(self, table: str, values: Mapping[str, object]) -> list[records.Step]:
        try:
            keys = fault_step_keys(find_fault_kind(kind_name(values["fault"])))
        except ConfigError as error:
            self._problems.add(self._problems.place(table, "fault"), error)
            return []
        found = self._settings(table, values, keys)
        if len(found) < len(keys):
            return []
        common = {"at_s", "fault", "target"}
        own: dict[str, Any] = {
            name: setting.value
            for name, setting in found.items()
            if name in values and name not in common
        }
        return [
            records.FaultStep(
                found["at_s"].value,
                found["fault"].value,
                found["target"].value,
                tuple(sorted(own.items())),
            )
        ]


def seconds(amount: records.Amount, parameters: Mapping[str, records.Parameter]) -> float:
    """Return a time [s]; of a parameter, its value."""
    if isinstance(amount, records.Reference):
        parameter = parameters[amount.name]
        return parameter.unit.to_si(parameter.value)
    return amount


def _latest(amount: records.Amount, parameters: Mapping[str, records.Parameter]) -> float:
    """Return a time [s]; of a parameter with a range, the end of that."""
    if isinstance(amount, records.Reference) and (span := parameters[amount.name].span):
        return parameters[amount.name].unit.to_si(span[1])
    return seconds(amount, parameters)


def _read_controller(document: Document, problems: Problems) -> records.Controller | None:
    if "controller" not in document:
        return None
    values = document["controller"]
    if not isinstance(values, dict):
        problems.add(problems.place("controller"), "is not a table; write it as [controller]")
        return None
    if "kind" in values:
        return (
            records.Controller(table=values) if find_kind("controller", values, problems) else None
        )
    found = read_table("controller", values, CONTROLLER_KEYS, problems)
    chosen = [name for name in found if found[name].value]
    if len(found) == len(CONTROLLER_KEYS) and len(chosen) != 1:
        place = problems.place("controller")
        problems.add(place, "needs a controller; give kind, firmware or example")
    if len(found) < len(CONTROLLER_KEYS):
        return None
    return records.Controller(found["firmware"].value, found["example"].value)


def _read_parameters(document: Document, problems: Problems) -> dict[str, records.Parameter]:
    parameters = {}
    for name, given in read_section(document, "parameters", problems).items():
        table = f"parameters.{name}"
        values = given.value if isinstance(given.value, dict) else {"value": given.value}
        found = read_table(table, values, PARAMETER_KEYS, problems)
        if len(found) < len(PARAMETER_KEYS):
            continue
        value, limits = found["value"].value, found["range"].value
        if limits and not limits[0] <= value <= limits[1]:
            wrong = f"{value:g} is outside its range [{limits[0]:g}, {limits[1]:g}]"
            problems.add(problems.place(table, "value"), f"{wrong}; give a value inside")
        parameters[name] = records.Parameter(name, value, limits)
    return parameters


def _read_expectations(
    file: Tables, problems: records.LocatedProblems
) -> tuple[records.Expectation, ...]:
    found: list[records.Expectation] = []
    tables = file.listed("expect")
    if not tables:
        right = 'give [[expect]] with id = "..." and that = "always axis1.P_A < 250 bar"'
        problems.add(problems.source, f"checks nothing; {right}")
    for table, values in tables:
        settings = read_table(table, values, EXPECT_KEYS, problems)
        if len(settings) < len(EXPECT_KEYS):
            continue
        spot = problems.find(table, "that") or records.Spot(1, 1)
        name = settings["id"].value
        if any(each.id == name for each in found):
            place = problems.place(table, "id")
            problems.add(place, f"{quote(name)} is there twice; give each its own")
        place_of_text = records.TextPlace(problems.source, *spot)
        found.append(records.Expectation(name, settings["that"].value, place_of_text))
    return tuple(found)


def _check_times(
    steps: Sequence[records.Step],
    parameters: Mapping[str, records.Parameter],
    duration: float,
    tables: Sequence[str],
    problems: Problems,
) -> None:
    """Note steps behind the end, and two that set one thing at one time."""
    taken: dict[tuple[object, ...], str] = {}
    for step, table in zip(steps, tables, strict=True):
        at = seconds(step.at, parameters)
        latest = _latest(step.at, parameters)
        place = problems.place(table, "at_s")
        if latest > duration:
            wrong = f"{latest:g} s is after the end at {duration:g} s"
            problems.add(place, f"{wrong}; give an earlier time or a longer duration_s")
        thing = (
            type(step),
            getattr(step, "kind", ""),
            getattr(step, "target", ""),
            round(at * 1e9),
        )
        if thing in taken:
            wrong = f"does what {taken[thing]} does at {at:g} s, too"
            problems.add(place, f"{wrong}; give one of them")
        taken.setdefault(thing, table)
