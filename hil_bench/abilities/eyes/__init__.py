"""Reads the frames of a CANopen bus: what each says in words, and what went wrong."""

from hil_bench.ability import Ability, Verb

ABILITY = Ability(
    "eyes",
    needs=("j1939", "recording"),
    verbs={
        "monitor": Verb(
            "bus",
            10,
            "print the frames of a bus in words: nodes, objects, values, errors",
            "hil_bench.abilities.eyes.verbs.monitor",
        ),
        "decode": Verb(
            "bus",
            20,
            "print a log of frames in words, or write its values or a DBC file",
            "hil_bench.abilities.eyes.verbs.decode",
        ),
        "explain": Verb(
            "bus",
            30,
            "find what went wrong in a log, in the order in which an expert looks",
            "hil_bench.abilities.eyes.verbs.explain",
        ),
        "record": Verb(
            "bus",
            40,
            "record frames and decoded values of any bus",
            "hil_bench.abilities.eyes.verbs.record",
        ),
        "bus-load": Verb(
            "bus",
            100,
            "compute load and response times of a bench on its buses",
            "hil_bench.abilities.eyes.verbs.bus_load",
        ),
    },
    options={"watch": "hil_bench.abilities.eyes.verbs.watch_options"},
    frame_reader="hil_bench.abilities.eyes.frame_text:FrameText",
)
