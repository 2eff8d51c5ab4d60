"""Recordings of what happens on a bench or a bus, and pictures of them."""

from hil_bench.ability import Ability, Verb

_HERE = "hil_bench.abilities.recording"

ABILITY = Ability(
    "recording",
    verbs={"plot": Verb("start", 50, "draw a recording", f"{_HERE}.verbs")},
)
