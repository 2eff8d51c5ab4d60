"""A bench.toml written from the data sheets of an axis."""

from hil_bench.ability import Ability, Verb

ABILITY = Ability(
    "new",
    verbs={
        "new": Verb(
            "start",
            20,
            "write a bench.toml from data sheets, and print what the axis can do",
            "hil_bench.abilities.new.verbs",
        ),
    },
)
