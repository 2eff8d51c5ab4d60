"""Program download into CANopen devices (CiA 302-3)."""

from hil_bench.ability import Ability

ABILITY = Ability("download", gives={"nodes": "hil_bench.abilities.download.programs"})
"""A memory for programs in the nodes whose EDS files have one."""
