"""Safety-relevant data objects of CANopen devices (EN 50325-5)."""

from hil_bench.ability import Ability

ABILITY = Ability("srdo", gives={"services": "hil_bench.abilities.srdo.nodes"})
"""SRDOs as a service of the nodes whose EDS files have them."""
