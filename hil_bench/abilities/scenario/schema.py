"""The keys of a scenario file (docs/scenarios.md explains them), and a JSON schema of them."""

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Final

from hil_bench.abilities.controllers.power import Power
from hil_bench.abilities.controllers.python.kind import EXAMPLES
from hil_bench.abilities.faults.kind import FaultKind
from hil_bench.abilities.faults.registry import COMMON_KEYS, all_kinds, kind_name
from hil_bench.abilities.scenario.records import NmtVerb
from hil_bench.config.settings import Key
from hil_bench.config.values import boolean, choice, describe, number, text, texts
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
HEAD_KEYS: Final = (
    Key("title", text, example='"Extends 100 mm"'),
    Key("bench", text),
    DURATION_KEY,
    Key("requirement_ids", texts, ()),
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
    for fault in all_kinds():
        forms = {**_STEP_FORMS, "fault": {"const": fault.name}}
        keys = fault_step_keys(fault)
        yield {
            **_table(keys, forms, _ANY, ["at_s", "fault", "target"]),
            "title": f"fault {fault.name}",
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
