"""Recorded frames on a bus again, and recorded set-points on the plant again."""

from hil_bench.ability import Ability, Verb

ABILITY = Ability(
    "replay",
    needs=("recording",),
    verbs={
        "replay": Verb(
            "run",
            50,
            "put recorded frames on a bus, or drive the plant with recorded set-points",
            "hil_bench.abilities.replay.verbs",
        ),
    },
)
