"""The panel: a web page that shows a running bench and breaks it, from a process of its own."""

from hil_bench.ability import Ability, Verb

DEFAULT_PORT = 8408

ABILITY = Ability(
    "panel",
    needs=("controllers", "eyes", "faults", "live", "recording", "scenario"),
    verbs={
        "panel": Verb(
            "run",
            40,
            "watch, set and break a running bench, on a web page",
            "hil_bench.abilities.panel.verbs",
        ),
    },
)
