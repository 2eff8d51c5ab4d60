"""A controller that moves the cylinder, shown without any set-up."""

from hil_bench.ability import Ability, Verb

ABILITY = Ability(
    "demo",
    needs=("modbus", "recording"),
    verbs={
        "demo": Verb(
            "start",
            10,
            "watch a controller move the cylinder; needs no set-up",
            "hil_bench.abilities.demo.verbs",
        ),
    },
)
