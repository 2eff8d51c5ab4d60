"""Analyses of the valve-controlled cylinder, offline (Ruderman 2017, section IV)."""

from hil_bench.ability import Ability, Verb

ABILITY = Ability(
    "analysis",
    verbs={
        "analyse": Verb(
            "more",
            20,
            "analyse valve and cylinder as the paper does: numbers, tables, figures",
            "hil_bench.abilities.analysis.verbs",
        )
    },
)
