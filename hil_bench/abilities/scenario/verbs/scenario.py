"""`hil-bench scenario`: check scenario files, list what they hold, convert them."""

import argparse
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from hil_bench.abilities.controllers.power import Power
from hil_bench.abilities.controllers.python.kind import EXAMPLES
from hil_bench.abilities.faults.registry import all_kinds
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.reading import (
    CONTROLLER_KEYS,
    EXPECT_KEYS,
    HEAD_KEYS,
    PARAMETER_KEYS,
    STEP_KEYS,
    fault_step_keys,
)
from hil_bench.abilities.scenario.records import NmtVerb, Scenario
from hil_bench.abilities.scenario.run import prepare
from hil_bench.abilities.scenario.writing import write_scenario
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.results import add_json_argument, print_results, warn_of
from hil_bench.config.settings import Key
from hil_bench.errors import ConfigError

_EXAMPLES = """\
examples:
  hil-bench scenario check sag.scenario.toml
  hil-bench scenario list tests/*.scenario.toml
  hil-bench scenario convert sag.scenario.toml sag.csv
  hil-bench scenario schema > scenario.schema.json
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "scenario",
        description="Check scenario files, list their content, and convert TOML to CSV and back.",
        epilog=_EXAMPLES,
    )
    actions = parser.add_subparsers(title="actions", metavar="ACTION", required=True)
    check = actions.add_parser("check", help="check files against their benches")
    check.add_argument("files", nargs="+", type=Path, metavar="FILE")
    add_json_argument(check)
    check.set_defaults(run=run_check)
    listing = actions.add_parser("list", help="print title, steps and requirements")
    listing.add_argument("files", nargs="+", type=Path, metavar="FILE")
    add_json_argument(listing)
    listing.set_defaults(run=run_list)
    convert = actions.add_parser(
        "convert", help="convert a file; the suffix of the new file gives its format"
    )
    convert.add_argument("source", type=Path, metavar="FILE", help=".toml or .csv")
    convert.add_argument(
        "target", type=Path, metavar="NEW", help="new file, .toml or .csv; must not exist"
    )
    convert.set_defaults(run=run_convert)
    schema = actions.add_parser("schema", help="print a JSON schema, for editors")
    schema.set_defaults(run=run_schema)


def run_check(args: argparse.Namespace) -> int:
    """Check all files; what is wrong in any of them is told at once.

    Raises:
        ConfigError: something is wrong.
    """
    lines, wrong, doubts = [], [], []
    for path in args.files:
        try:
            scenario = load_scenario(path)
            doubts += prepare(scenario).doubts
        except ConfigError as error:
            wrong.append(str(error))
        else:
            lines.append(f"{path}: ok; {_summary(scenario)}")
    if wrong:
        raise ConfigError("\n".join(wrong))
    warn_of(doubts)
    print_results(args, lines, {"checked": args.files})
    return ExitCode.DONE


def run_list(args: argparse.Namespace) -> int:
    """Print what files hold."""
    found = {str(path): load_scenario(path) for path in args.files}
    lines = []
    for path, scenario in found.items():
        lines.append(f"{path}: {scenario.title}; {_summary(scenario)}")
        lines += [f"  {each.id}  {each.that}" for each in scenario.expectations]
    content = {
        path: {
            "title": scenario.title,
            "duration_s": scenario.duration,
            "requirement_ids": scenario.requirement_ids,
            "expectations": {each.id: each.that for each in scenario.expectations},
        }
        for path, scenario in found.items()
    }
    print_results(args, lines, content)
    return ExitCode.DONE


def run_convert(args: argparse.Namespace) -> int:
    """Write a scenario to a new file.

    Raises:
        ConfigError: the file is there already.
    """
    if args.target.exists():
        raise ConfigError(f"{args.target}: is there already; give the name of a new file")
    write_scenario(load_scenario(args.source), args.target)
    return ExitCode.DONE


def run_schema(_args: argparse.Namespace) -> int:
    """Print the schema of scenario files."""
    print(json.dumps(scenario_schema(), indent=2))
    return ExitCode.DONE


def _summary(scenario: Scenario) -> str:
    counts = (
        f"{scenario.duration:g} s",
        _number(len(scenario.steps), "step"),
        _number(len(scenario.expectations), "requirement"),
    )
    return ", ".join(counts)


def _number(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


# A JSON schema of scenario files, made from their keys: editors complete and check by it.

_Schema = dict[str, object]

_NUMBER: Final[_Schema] = {"type": "number"}
_TEXT: Final[_Schema] = {"type": "string"}
_TEXTS: Final[_Schema] = {"type": "array", "items": _TEXT}
_AMOUNT: Final[_Schema] = {"type": ["number", "string"]}
_ANY: Final[_Schema] = {"type": ["number", "string", "boolean"]}
_VALUES: Final[_Schema] = {"type": "object", "minProperties": 1, "additionalProperties": _ANY}

_HEAD_FORMS: Final[dict[str, _Schema]] = {"duration_s": _NUMBER, "requirement_ids": _TEXTS}
_CONTROLLER_FORMS: Final[dict[str, _Schema]] = {
    "firmware": _TEXTS,
    "example": {"enum": sorted(EXAMPLES)},
}
_PARAMETER_FORMS: Final[dict[str, _Schema]] = {
    "value": _NUMBER,
    "range": {"type": "array", "items": _NUMBER, "minItems": 2, "maxItems": 2},
}
_STEP_FORMS: Final[dict[str, _Schema]] = {
    "at_s": _AMOUNT,
    "over_s": _AMOUNT,
    "target": _TEXT,
    "table": _TEXT,
    "nmt": {"enum": [each.value for each in NmtVerb]},
    "sync": {"type": "boolean"},
    "firmware": {"enum": [each.value for each in Power]},
}


_CONTROLLER_OF_A_KIND: Final[_Schema] = {
    "type": "object",
    "properties": {"kind": _TEXT},
    "required": ["kind"],  # beside it the keys of the kind
}


def scenario_schema() -> _Schema:
    """Return the schema (JSON Schema 2020-12) of a scenario as TOML."""
    head = _table(HEAD_KEYS, _HEAD_FORMS, _TEXT, ["title", "duration_s", "expect"])
    parameter = _table(PARAMETER_KEYS, _PARAMETER_FORMS, _NUMBER, ["value"])
    plain = _table(CONTROLLER_KEYS, _CONTROLLER_FORMS, _TEXT) | {"minProperties": 1}
    head["properties"] = {
        **_properties(HEAD_KEYS, _HEAD_FORMS, _TEXT),
        "controller": {"anyOf": [plain, _CONTROLLER_OF_A_KIND]},
        "parameters": {"type": "object", "additionalProperties": {"anyOf": [_NUMBER, parameter]}},
        "step": {"type": "array", "items": {"anyOf": list(_steps())}},
        "expect": {
            "type": "array",
            "minItems": 1,
            "items": _table(EXPECT_KEYS, {}, _TEXT, ["id", "that"]),
        },
    }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Scenario of hil-bench",
        **head,
    }


def _steps() -> Iterable[_Schema]:
    for form, keys in STEP_KEYS.items():
        kind = "set" if form in {"set", "table"} else form
        what = {"set": _VALUES, "table": _TEXT}.get(form, {})
        forms = {**_STEP_FORMS, "set": what}
        required = [key.name for key in keys if key.default is None]
        yield {**_table(keys, forms, _ANY, required), "title": f"{kind} ({form})"}
    for fault in all_kinds():
        forms = {**_STEP_FORMS, "fault": {"const": fault.name}}
        keys = fault_step_keys(fault)
        yield {
            **_table(keys, forms, _ANY, ["at_s", "fault", "target"]),
            "title": f"fault {fault.name}",
        }


def _table(
    keys: Sequence[Key], forms: dict[str, _Schema], otherwise: _Schema, required: Sequence[str] = ()
) -> _Schema:
    return {
        "type": "object",
        "properties": _properties(keys, forms, otherwise),
        "required": list(required),
        "additionalProperties": False,
    }


def _properties(keys: Sequence[Key], forms: dict[str, _Schema], otherwise: _Schema) -> _Schema:
    return {key.name: forms.get(key.name, otherwise) for key in keys}
