"""The twin beside the machine: the bench's plant on the commands that the real valve gets.

`decoder` reads what the machine's devices say off the bus, `sample_clock` when they measured it;
`node_states` and `followed_valve` take over the states in which the machine is, so that the twin
can join at any moment. `twin` runs the same plant on the frames that the controller sends,
`axis_twin` sets both side by side. Nothing is ever sent.
"""

from hil_bench.ability import Ability, Verb

ABILITY = Ability(
    "shadow",
    needs=("recording",),
    verbs={
        "shadow": Verb(
            "machine",
            30,
            "run the plant beside a machine on its commands, and show the differences",
            "hil_bench.abilities.shadow.verbs",
        ),
    },
)
