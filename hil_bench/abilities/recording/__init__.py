"""Recordings of what happens on a bench or a bus, and pictures of them."""

from hil_bench.ability import Ability, Verb

_HERE = "hil_bench.abilities.recording"

ABILITY = Ability(
    "recording",
    verbs={"plot": Verb("start", 50, "draw a recording", f"{_HERE}.verbs")},
    options={"run": f"{_HERE}.options"},
    gives={
        "ctl": f"{_HERE}.ctl",
        "feed": f"{_HERE}.requests",
        "picture": f"{_HERE}.plot",
        "pytest": f"{_HERE}.fixtures",
        "record": f"{_HERE}.sessions",
        "run": f"{_HERE}.options",
    },
    fixtures=f"{_HERE}.fixtures",
    exports={
        "RecordingWish": f"{_HERE}.report",
        "open_recording": f"{_HERE}.reading",
        "read_frames": f"{_HERE}.frames",
    },
)
