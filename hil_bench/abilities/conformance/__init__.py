"""Checks whether a device keeps to CiA 301 and CiA 305, from the controller's side of the bus.

A check is a function that sends raw frames and judges what comes back; it gets the device under
test, and with it the wire and its clock, so it does the same in virtual time and on a machine. The
checks are kept by subject, each with the clause that it stands for; `suite` runs them.
"""

from hil_bench.ability import Ability, Verb

ABILITY = Ability(
    "conformance",
    verbs={
        "conformance": Verb(
            "bus",
            80,
            "check a device against CiA 301 and CiA 305, clause by clause",
            "hil_bench.abilities.conformance.verbs",
        ),
        "check-eds": Verb(
            "bus",
            90,
            "find errors in EDS files, with line numbers",
            "hil_bench.abilities.conformance.eds_check",
        ),
    },
)
