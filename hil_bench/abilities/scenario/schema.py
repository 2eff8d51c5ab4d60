"""A JSON schema of scenario files, made from their keys: editors complete and check by it."""

from collections.abc import Iterable, Sequence
from typing import Final

from hil_bench.abilities.controllers.power import Power
from hil_bench.abilities.controllers.python.kind import EXAMPLES
from hil_bench.abilities.scenario.records import NmtVerb
from hil_bench.abilities.scenario.step_keys import (
    CONTROLLER_KEYS,
    EXPECT_KEYS,
    HEAD_KEYS,
    PARAMETER_KEYS,
    STEP_KEYS,
    fault_step_keys,
)
from hil_bench.config.settings import Key
from hil_bench.devices.faults.kinds import FaultKind

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
        "parameters": {
            "type": "object",
            "additionalProperties": {"anyOf": [_NUMBER, parameter]},
        },
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
    for fault in FaultKind:
        forms = {**_STEP_FORMS, "fault": {"const": fault.value}}
        keys = fault_step_keys(fault)
        yield {
            **_table(keys, forms, _ANY, ["at_s", "fault", "target"]),
            "title": f"fault {fault.value}",
        }


def _table(
    keys: Sequence[Key],
    forms: dict[str, _Schema],
    otherwise: _Schema,
    required: Sequence[str] = (),
) -> _Schema:
    return {
        "type": "object",
        "properties": _properties(keys, forms, otherwise),
        "required": list(required),
        "additionalProperties": False,
    }


def _properties(keys: Sequence[Key], forms: dict[str, _Schema], otherwise: _Schema) -> _Schema:
    return {key.name: forms.get(key.name, otherwise) for key in keys}
