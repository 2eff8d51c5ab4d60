"""Thousands of runs of scenarios, and a search for what makes a requirement fail."""

from hil_bench.ability import Ability, Verb

ABILITY = Ability(
    "campaign",
    needs=("controllers", "scenario"),
    verbs={
        "campaign": Verb(
            "test",
            40,
            "run scenarios over parameters, benches and firmware, thousands of times",
            "hil_bench.abilities.campaign.verbs.campaign",
        ),
        "falsify": Verb(
            "test",
            50,
            "search for parameters that make a requirement fail",
            "hil_bench.abilities.campaign.verbs.falsify",
        ),
    },
    exports={"run_campaign": "hil_bench.abilities.campaign.table"},
)
