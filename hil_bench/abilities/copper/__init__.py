"""Buses like copper: exact lengths of frames, arbitration and errors (ISO 11898-1)."""

from hil_bench.ability import Ability

ABILITY = Ability(
    "copper",
    bus_tables={"wire": "hil_bench.abilities.copper.section:read_wire"},
    gives={
        "eyes": "hil_bench.abilities.copper.measured_traffic",
        "faults": "hil_bench.abilities.copper.fault_kinds",
    },
)
