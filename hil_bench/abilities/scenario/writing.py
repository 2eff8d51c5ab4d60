"""A scenario to a file, TOML or CSV; manual commands to a running bench as its steps."""

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from hil_bench.abilities.common.files import whole_file
from hil_bench.abilities.faults.live import fault_table
from hil_bench.abilities.scenario import records
from hil_bench.abilities.scenario.load import TIME
from hil_bench.errors import ConfigError, about_file
from hil_bench.units import si_unit

# A scenario to a file: TOML or CSV, whichever it came from.

WRITTEN = "# Written by hil-bench, which replaces files that begin so."


def write_scenario(scenario: records.Scenario, path: Path) -> None:
    """Write a scenario to a file, by its suffix CSV or TOML; a `ConfigError` where it cannot be."""
    is_sheet = path.suffix.lower() == ".csv"
    text = to_csv(scenario) if is_sheet else f"{WRITTEN}\n{to_toml(scenario)}"
    with about_file(path), whole_file(path) as file:
        file.write_text(text, encoding="utf-8")


def to_toml(scenario: records.Scenario) -> str:
    """Return a scenario as TOML."""
    lines = [f"{key} = {toml_value(value)}" for key, value in _head(scenario).items()]
    if scenario.controller:
        pairs = _controller(scenario.controller)
        lines += [
            "",
            "[controller]",
            *(f"{key} = {toml_value(value)}" for key, value in pairs.items()),
        ]
    if scenario.parameters:
        lines += ["", "[parameters]"]
    for each in scenario.parameters:
        table: dict[str, object] = {"value": each.value}
        if each.span:
            table["range"] = list(each.span)
        lines.append(f"{_toml_key(each.name)} = {toml_value(table)}")
    for step in scenario.steps:
        lines += ["", "[[step]]", *(f"{k} = {toml_value(v)}" for k, v in step_table(step).items())]
    for expectation in scenario.expectations:
        pairs = {"id": expectation.id, "that": expectation.that}
        lines += [
            "",
            "[[expect]]",
            *(f"{key} = {toml_value(value)}" for key, value in pairs.items()),
        ]
    return "\n".join(lines) + "\n"


def _controller(controller: records.Controller) -> Mapping[str, object]:
    """Return the table of a controller."""
    if controller.table:
        return controller.table
    if controller.example:
        return {"example": controller.example}
    return {"firmware": list(controller.firmware)}


def to_csv(scenario: records.Scenario) -> str:
    """Return a scenario as CSV: its head, then a row a step.

    Raises:
        ConfigError: its controller is of a kind, which has no cells in a sheet.
    """
    if scenario.controller and scenario.controller.table:
        wrong = "has no cells in a sheet; write TOML"
        raise ConfigError(f"{scenario.path}: controller.kind: {wrong}")
    rows: list[list[str]] = []
    for key, value in _head(scenario).items():
        rows.append([key, *(value if isinstance(value, list) else [_cell(value)])])
    if scenario.controller and scenario.controller.example:
        rows.append(["example", scenario.controller.example])
    elif scenario.controller:
        rows.append(["firmware", *scenario.controller.firmware])
    for each in scenario.parameters:
        numbers = (each.value, *(each.span or ()))
        rows.append(["parameter", each.name, *map(_cell, numbers)])
    rows += [["expect", each.id, each.that] for each in scenario.expectations]
    cells = [_step_cell(step) for step in scenario.steps]
    names = list(dict.fromkeys(name for name, _ in cells))
    if names:
        rows.append([TIME, *names])
    for step, (name, text) in zip(scenario.steps, cells, strict=True):
        rows.append([_cell(_plain(step.at)), *[""] * names.index(name), text])
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(rows)
    return out.getvalue()


def step_table(step: records.Step) -> dict[str, object]:
    """Return a step as a table ``[[step]]`` has it."""
    table: dict[str, object] = {"at_s": _plain(step.at)}
    match step:
        case records.SetStep() if step.table:
            table |= {"set": step.target, "table": step.table}
        case records.SetStep():
            table["set"] = {step.target: _plain(step.value)}
            if step.over != 0.0:
                table["over_s"] = _plain(step.over)
        case records.FaultStep():
            table |= {"fault": step.kind, "target": step.target}
            table |= {key: _plain(value) for key, value in step.values}
        case records.NmtStep():
            table |= {"nmt": step.command.value, "target": step.target}
        case records.SyncStep():
            table["sync"] = step.is_on
        case records.FirmwareStep():
            table["firmware"] = step.command.value
            table |= {"target": step.target} if step.target else {}
    return table


def _head(scenario: records.Scenario) -> dict[str, object]:
    head: dict[str, object] = {"title": scenario.title}
    if scenario.bench is not None:
        head["bench"] = scenario.bench
    head["duration_s"] = scenario.duration
    if scenario.requirement_ids:
        head["requirement_ids"] = list(scenario.requirement_ids)
    return head


def _step_cell(step: records.Step) -> tuple[str, str]:
    """Return the column of a step, and its cell there."""
    match step:
        case records.SetStep() if step.table:
            return step.target, f"table {step.table}"
        case records.SetStep():
            value = _cell(_plain(step.value))
            over = f"-> {value} over {_cell(_plain(step.over))}"
            return step.target, value if step.over == 0.0 else over
        case records.FaultStep():
            pairs = " ".join(f"{key}={_cell(_plain(value))}" for key, value in step.values)
            return f"fault:{step.kind} {step.target}", pairs or "on"
        case records.NmtStep():
            return f"nmt:{step.target}", step.command.value
        case records.SyncStep():
            return "sync", "on" if step.is_on else "off"
        case records.FirmwareStep():
            return f"firmware:{step.target}".rstrip(":"), step.command.value


def _plain(value: records.Amount | object) -> object:
    return value.name if isinstance(value, records.Reference) else value


def _cell(value: object) -> str:
    return repr(value) if isinstance(value, float) else str(value)


def toml_value(value: Any) -> str:  # noqa: ANN401 - whatever TOML can hold
    """Return a value as TOML.

    Raises:
        TypeError: TOML has no such values.
    """
    match value:
        case bool():
            return "true" if value else "false"
        case int() | float():
            return repr(value)
        case str():
            return _toml_text(value)
        case Mapping():
            pairs = ", ".join(
                f"{_toml_key(key)} = {toml_value(each)}" for key, each in value.items()
            )
            return f"{{ {pairs} }}"
        case Iterable():
            return f"[{', '.join(toml_value(each) for each in value)}]"
        case _:
            raise TypeError(f"{type(value).__name__} has no place in TOML")


def _toml_text(text: str) -> str:
    if '"' in text and "'" not in text and text.isprintable():
        return f"'{text}'"
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _toml_key(key: str) -> str:
    is_bare = key.isascii() and key.replace("_", "").replace("-", "").isalnum()
    return key if is_bare else _toml_text(key)


# Conversion of manual commands to a running bench into the steps of a scenario.

_DIGITS = 9  # of a time: whole nanoseconds


class JournalSteps:
    """The steps that do again what a journal tells.

    What was set or broken before the beginning, and still is, becomes a step at 0 s.

    Args:
        hello: what the bench says of itself.
        begin: bench time that the scenario has at `lead` [s].
        end: bench time from which on commands are left out [s].
        lead: time of the scenario before its first step, for the controller to start [s].

    Attributes:
        steps: in the order in which they act.
        remarks: what a scenario cannot have, a line each.
    """

    def __init__(
        self, hello: Mapping[str, Any], begin: float, end: float, lead: float = 0.0
    ) -> None:
        self.remarks: list[str] = []
        self._hello = hello
        self._begin, self._end, self._lead = begin, end, lead
        self._faults: dict[int, tuple[records.FaultStep, float | None]] = {}
        self._settings: list[records.SetStep] = []

    @property
    def steps(self) -> tuple[records.Step, ...]:
        """In the order in which they act."""
        limit = self._at(self._end)
        faults = [
            step
            for step, ends in self._faults.values()
            if (ends is None or ends > 0.0) and _seconds(step) < limit
        ]
        return tuple(sorted([*self._latest(), *faults], key=_seconds))

    def add(self, entries: Iterable[Mapping[str, Any]]) -> None:
        """Take entries of a journal, the oldest first."""
        for entry in entries:
            if entry["time"] >= self._end:
                return
            match entry["do"]:
                case "begin_fault":
                    self._begin_fault(entry)
                case "clear_fault":
                    self._clear(entry["fields"].get("number"), entry["time"])
                case "set_plant" | "set_object":
                    self._set(entry)

    def _at(self, time: float) -> float:
        """Return the time in the scenario: 0 for what was before the beginning."""
        if time < self._begin:
            return 0.0
        return round(time - self._begin + self._lead, _DIGITS)

    def _begin_fault(self, entry: Mapping[str, Any]) -> None:
        fields = entry["fields"]
        if not fields:
            self.remarks.append(f"the fault at {entry['time']:g} s has too long arguments")
            return
        begins = max(entry["time"], fields.get("arguments", {}).get("at") or 0.0)
        table = fault_table(fields, self._hello)
        kind, target = table.pop("kind"), table.pop("target")
        ends = None if "for_s" not in table else begins + table["for_s"]
        if ends is not None and begins < self._begin < ends:
            table["for_s"] = self._at(ends)  # what is left of it, and the lead
        step = records.FaultStep(self._at(begins), kind, target, tuple(sorted(table.items())))
        gone = ends is not None and ends <= self._begin
        self._faults[entry["number"]] = step, 0.0 if gone else None

    def _clear(self, number: int | None, time: float) -> None:
        if number is not None and number not in self._faults:
            self.remarks.append(f"fault {number}, cleared at {time:g} s, was not begun by hand")
        for each in [*self._faults] if number is None else [number]:
            if each in self._faults:
                self._end_fault(each, time)

    def _end_fault(self, number: int, time: float) -> None:
        step, ends = self._faults[number]
        if ends is not None:
            return
        lasts = round(self._at(time) - _seconds(step), _DIGITS) if time > self._begin else 0.0
        values = dict(step.values)
        values["for_s"] = min(lasts, float(str(values.get("for_s", lasts))))
        self._faults[number] = replace(step, values=tuple(sorted(values.items()))), lasts

    def _set(self, entry: Mapping[str, Any]) -> None:
        fields = entry["fields"]
        value = fields.get("value")
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            where = f"at {entry['time']:g} s"
            self.remarks.append(f"a value that is no number was set {where}; scenarios have none")
            return
        owner, name = (
            (fields["axis"], fields["quantity"])
            if entry["do"] == "set_plant"
            else (fields["node"], fields["name"])
        )
        factor = self._factor(owner, name)
        step = records.SetStep(self._at(entry["time"]), f"{owner}.{name}", float(value) * factor)
        self._settings.append(step)

    def _factor(self, owner: str, name: str) -> float:
        """Return the value of 1 in SI: a J1939 signal is set in its own unit."""
        signals = self._hello.get("ecus", {}).get(owner, {}).get("signals", {})
        return si_unit(signals[name]["unit"])[1] if name in signals else 1.0

    def _latest(self) -> Sequence[records.SetStep]:
        """Return the settings, of those at one time for one target the last one."""
        return list({(step.at, step.target): step for step in self._settings}.values())


def _seconds(step: records.Step) -> float:
    assert not isinstance(step.at, records.Reference)  # noqa: S101 - a journal names no parameters
    return step.at
