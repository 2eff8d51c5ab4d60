"""Scenarios and requirements: tests over time, in files that read like a test plan."""

from hil_bench.ability import Ability, Verb

ABILITY = Ability(
    "scenario",
    needs=("commissioning", "controllers", "eyes", "faults", "j1939", "modbus", "recording"),
    verbs={
        "test": Verb(
            "test",
            10,
            "play scenarios, and judge their requirements",
            "hil_bench.abilities.scenario.verbs.test",
        ),
        "judge": Verb(
            "test",
            20,
            "judge recordings by requirements: verdict, margin, deciding comparison",
            "hil_bench.abilities.scenario.verbs.judge",
        ),
        "scenario": Verb(
            "test",
            30,
            "check, list and convert scenario files",
            "hil_bench.abilities.scenario.verbs.scenario",
        ),
    },
    options={"run": "hil_bench.abilities.scenario.verbs.run_options"},
    collectors={".scenario.toml": "hil_bench.abilities.scenario.pytest_items:ScenarioFile"},
)
