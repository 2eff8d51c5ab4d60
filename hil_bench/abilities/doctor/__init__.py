"""Examination of this machine for a bench in real time, with advice on improvements.

Each module looks at one topic and gives findings; none of them changes anything.
"""

from hil_bench.ability import Ability, Verb

ABILITY = Ability(
    "doctor",
    verbs={
        "doctor": Verb(
            "more",
            10,
            "measure what this machine can do in real time, and name what to change",
            "hil_bench.abilities.doctor.verbs",
        ),
    },
)
