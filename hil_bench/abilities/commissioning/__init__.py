"""The controller's side of a bus that is not known yet: who is there, and is it what it should be.

Everything here talks through `hil_drivers`, so it does the same on the virtual bench and
on a machine.
"""

from hil_bench.ability import Ability, Verb

ABILITY = Ability(
    "commissioning",
    needs=("eyes", "recording"),
    verbs={
        "commission": Verb(
            "machine",
            10,
            "take an axis into operation step by step, with report and recording",
            "hil_bench.abilities.commissioning.verbs.commission",
        ),
        "boot": Verb(
            "bus",
            60,
            "boot a network as its NMT master: check, configure and start its devices",
            "hil_bench.abilities.commissioning.verbs.boot",
        ),
        "scan": Verb(
            "bus",
            50,
            "find the nodes of a bus, with identity and state",
            "hil_bench.abilities.commissioning.verbs.scan",
        ),
        "program": Verb(
            "bus",
            70,
            "download a program into a device, or show the one that it has",
            "hil_bench.abilities.commissioning.verbs.program",
        ),
    },
    options={"check": "hil_bench.abilities.commissioning.verbs.bus_check_arguments"},
)
