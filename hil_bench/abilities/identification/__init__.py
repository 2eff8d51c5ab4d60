"""Identification: the plant's parameters, and what is known of them, from a recording."""

from hil_bench.ability import Ability, Verb

ABILITY = Ability(
    "identification",
    needs=("commissioning", "recording", "scenario"),
    verbs={
        "identify": Verb(
            "machine",
            20,
            "estimate the plant's parameters with confidence intervals from recordings",
            "hil_bench.abilities.identification.verbs.identify",
        )
    },
)
