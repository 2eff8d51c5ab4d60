"""Devices on SAE J1939 on the buses of a bench."""

from hil_bench.ability import Ability

ABILITY = Ability(
    "j1939",
    tables={"j1939": "hil_bench.abilities.j1939.configuration.ecus:EcusSection"},
    gives={"faults": "hil_bench.abilities.j1939.fault_kinds"},
)
