"""The live view of a running bench: its feed, and those who watch it or give it commands."""

from hil_bench.ability import Ability, Verb

_HERE = "hil_bench.abilities.live"

ABILITY = Ability(
    "live",
    verbs={
        "ctl": Verb("run", 20, "read, set and break a running bench, from a shell", f"{_HERE}.ctl"),
        "watch": Verb(
            "run", 30, "watch a running bench or any bus, in the terminal", f"{_HERE}.watch"
        ),
    },
    options={"run": f"{_HERE}.places", "run seldom": "hil_bench.abilities.common.shown_units"},
    gives={"view": f"{_HERE}.view"},
    exports={"AttachedBench": f"{_HERE}.attached", "attach": f"{_HERE}.attached"},
)
