"""An axis of a bench as an FMU for co-simulation (FMI 2.0), for other tools."""

from hil_bench.ability import Ability, Verb

ABILITY = Ability(
    "fmu",
    verbs={
        "export-fmu": Verb(
            "more",
            30,
            "write an axis as an FMU for co-simulation in other tools",
            "hil_bench.abilities.fmu.verbs",
        ),
    },
)
