"""A scenario to a file: TOML or CSV, whichever it came from."""

import csv
import io
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from hil_bench.abilities.scenario.csv_form import TIME
from hil_bench.abilities.scenario.records import (
    Amount,
    Controller,
    FaultStep,
    FirmwareStep,
    NmtStep,
    Reference,
    Scenario,
    SetStep,
    Step,
    SyncStep,
)
from hil_bench.errors import ConfigError, about_file, whole_file

WRITTEN = "# Written by hil-bench, which replaces files that begin so."


def write_scenario(scenario: Scenario, path: Path) -> None:
    """Write a scenario to a file, by its suffix CSV or TOML; a `ConfigError` where it cannot be."""
    is_sheet = path.suffix.lower() == ".csv"
    text = to_csv(scenario) if is_sheet else f"{WRITTEN}\n{to_toml(scenario)}"
    with about_file(path), whole_file(path) as file:
        file.write_text(text, encoding="utf-8")


def to_toml(scenario: Scenario) -> str:
    """Return a scenario as TOML."""
    lines = [f"{key} = {_toml(value)}" for key, value in _head(scenario).items()]
    if scenario.controller:
        pairs = _controller(scenario.controller)
        lines += ["", "[controller]", *(f"{key} = {_toml(value)}" for key, value in pairs.items())]
    if scenario.parameters:
        lines += ["", "[parameters]"]
    for each in scenario.parameters:
        table: dict[str, object] = {"value": each.value}
        if each.span:
            table["range"] = list(each.span)
        lines.append(f"{_toml_key(each.name)} = {_toml(table)}")
    for step in scenario.steps:
        lines += ["", "[[step]]", *(f"{k} = {_toml(v)}" for k, v in step_table(step).items())]
    for expectation in scenario.expectations:
        pairs = {"id": expectation.id, "that": expectation.that}
        lines += ["", "[[expect]]", *(f"{key} = {_toml(value)}" for key, value in pairs.items())]
    return "\n".join(lines) + "\n"


def _controller(controller: Controller) -> Mapping[str, object]:
    """Return the table of a controller."""
    if controller.table:
        return controller.table
    if controller.example:
        return {"example": controller.example}
    return {"firmware": list(controller.firmware)}


def to_csv(scenario: Scenario) -> str:
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


def step_table(step: Step) -> dict[str, object]:
    """Return a step as a table ``[[step]]`` has it."""
    table: dict[str, object] = {"at_s": _plain(step.at)}
    match step:
        case SetStep() if step.table:
            table |= {"set": step.target, "table": step.table}
        case SetStep():
            table["set"] = {step.target: _plain(step.value)}
            if step.over != 0.0:
                table["over_s"] = _plain(step.over)
        case FaultStep():
            table |= {"fault": step.kind, "target": step.target}
            table |= {key: _plain(value) for key, value in step.values}
        case NmtStep():
            table |= {"nmt": step.command.value, "target": step.target}
        case SyncStep():
            table["sync"] = step.is_on
        case FirmwareStep():
            table["firmware"] = step.command.value
            table |= {"target": step.target} if step.target else {}
    return table


def _head(scenario: Scenario) -> dict[str, object]:
    head: dict[str, object] = {"title": scenario.title}
    if scenario.bench is not None:
        head["bench"] = scenario.bench
    head["duration_s"] = scenario.duration
    if scenario.requirement_ids:
        head["requirement_ids"] = list(scenario.requirement_ids)
    return head


def _step_cell(step: Step) -> tuple[str, str]:
    """Return the column of a step, and its cell there."""
    match step:
        case SetStep() if step.table:
            return step.target, f"table {step.table}"
        case SetStep():
            value = _cell(_plain(step.value))
            over = f"-> {value} over {_cell(_plain(step.over))}"
            return step.target, value if step.over == 0.0 else over
        case FaultStep():
            pairs = " ".join(f"{key}={_cell(_plain(value))}" for key, value in step.values)
            return f"fault:{step.kind} {step.target}", pairs or "on"
        case NmtStep():
            return f"nmt:{step.target}", step.command.value
        case SyncStep():
            return "sync", "on" if step.is_on else "off"
        case FirmwareStep():
            return f"firmware:{step.target}".rstrip(":"), step.command.value


def _plain(value: Amount | object) -> object:
    return value.name if isinstance(value, Reference) else value


def _cell(value: object) -> str:
    return repr(value) if isinstance(value, float) else str(value)


def _toml(value: Any) -> str:  # noqa: ANN401 - whatever TOML can hold
    match value:
        case bool():
            return "true" if value else "false"
        case int() | float():
            return repr(value)
        case str():
            return _toml_text(value)
        case Mapping():
            pairs = ", ".join(f"{_toml_key(key)} = {_toml(each)}" for key, each in value.items())
            return f"{{ {pairs} }}"
        case Iterable():
            return f"[{', '.join(_toml(each) for each in value)}]"
        case _:
            raise TypeError(f"{type(value).__name__} has no place in TOML")


def _toml_text(text: str) -> str:
    if '"' in text and "'" not in text and text.isprintable():
        return f"'{text}'"
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _toml_key(key: str) -> str:
    is_bare = key.isascii() and key.replace("_", "").replace("-", "").isalnum()
    return key if is_bare else _toml_text(key)
