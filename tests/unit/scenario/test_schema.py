"""The JSON schema names the keys that the files take, no others."""

import json
import tomllib
from pathlib import Path

import pytest

from hil_bench.abilities.faults.registry import FAULT_KINDS
from hil_bench.abilities.scenario.verbs.scenario import scenario_schema

EXAMPLES = sorted((Path(__file__).parents[3] / "examples" / "scenarios").glob("*.toml"))


def fits(value, schema):
    """Return whether a value fits the part of JSON Schema that the schema uses."""
    if "anyOf" in schema:
        return any(fits(value, each) for each in schema["anyOf"])
    if "const" in schema or "enum" in schema:
        return value in schema.get("enum", [schema.get("const")])
    types = {"number": (int, float), "string": str, "boolean": bool, "array": list, "object": dict}
    named = schema.get("type", [])
    named = [named] if isinstance(named, str) else named
    if named and not any(isinstance(value, types[name]) for name in named):
        return False
    if isinstance(value, list):
        return len(value) >= schema.get("minItems", 0) and all(
            fits(each, schema.get("items", {})) for each in value
        )
    if isinstance(value, dict):
        known, rest = schema.get("properties", {}), schema.get("additionalProperties", {})
        inside = all(
            fits(each, known[name]) if name in known else rest is not False and fits(each, rest)
            for name, each in value.items()
        )
        return inside and all(name in value for name in schema.get("required", []))
    return True


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_the_examples_fit(path):
    assert fits(tomllib.loads(path.read_text(encoding="utf-8")), scenario_schema())


def whole(**more):
    expect = [{"id": "R", "that": "always axis1.P_A < 250 bar"}]
    return {"title": "T", "duration_s": 1.0, "expect": expect} | more


def test_each_kind_of_step_fits():
    steps = [
        {"at_s": 1, "set": {"axis1.load": "5 kN"}, "over_s": "ramp_s"},
        {"at_s": 1, "set": "valve.spool_setpoint", "table": "a.csv"},
        {"at_s": "t_s", "nmt": "start", "target": "all"},
        {"at_s": 1, "sync": True},
        {"at_s": 1, "firmware": "kill"},
        *(
            {"at_s": 1, "fault": kind, "target": "valve", "for_s": 1}
            for kind in FAULT_KINDS.built_in
        ),
    ]
    assert [step for step in steps if not fits(whole(step=[step]), scenario_schema())] == []


@pytest.mark.parametrize(
    "wrong",
    [
        {"expect": []},
        {"heading": "T"},
        {"duration_s": "long"},
        {"controller": {"example": "nobody"}},
        {"parameters": {"a_mm": {"range": [1, 2]}}},
        {"step": [{"at_s": 1, "fault": "drop_supply", "target": "axis1", "pressure_mbar": 1}]},
        {"step": [{"fault": "freeze", "target": "position"}]},
        {"step": [{"at_s": 1, "nmt": "begin", "target": "all"}]},
    ],
)
def test_what_is_wrong_does_not_fit(wrong):
    assert not fits(whole(**wrong), scenario_schema())


def test_the_verb_prints_it(cli):
    assert json.loads(cli("scenario schema").out) == scenario_schema()
