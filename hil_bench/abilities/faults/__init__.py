"""Faults of a bench: of its sensors, valves, supplies, plants, nodes and buses."""

from hil_bench.ability import Ability

_HERE = "hil_bench.abilities.faults"

ABILITY = Ability(
    "faults",
    options={"run": f"{_HERE}.options", "check": f"{_HERE}.options"},
    gives={
        "arguments": f"{_HERE}.options",
        "ctl": f"{_HERE}.ctl",
        "feed": f"{_HERE}.requests",
    },
)
