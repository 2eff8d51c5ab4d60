"""The electronics of a hydraulic drive, which turns a motor by CiA 402."""

from hil_bench.ability import Ability

ABILITY = Ability("drive", gives={"kinds": "hil_bench.abilities.drive.kind"})
