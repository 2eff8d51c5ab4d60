"""Devices on SAE J1939 on the buses of a bench."""

from hil_bench.ability import Ability

ABILITY = Ability("j1939")
