"""Machines with one fault each, of which the commissioning side is not told."""

from pathlib import Path

EXAMPLES = Path(__file__).parents[2] / "examples"

SOUND = (EXAMPLES / "real_sensors.toml").read_text(encoding="utf-8")
"""As the data sheet of the built-in bench says, with sensors as they are."""

SWAPPED = SOUND.replace("P_A", "P_?").replace("P_B", "P_A").replace("P_?", "P_B")
WRONG_REVISION = f'{SOUND}\n[nodes.position.objects]\n"0x1018.03" = 0x00020001\n'


def with_fault(kind: str, target: str) -> str:
    """Return a sound machine that has a fault from the start."""
    return f'{SOUND}\n[[faults]]\nkind = "{kind}"\ntarget = "{target}"\n'


OIL = "[plant.axis1]\nbulk_modulus_mpa = 700\nmoving_mass_kg = 200\n"
"""Of a data sheet with real oil and a greater mass."""

AIR = "entrained_air_percent = 10\n"
"""Behind `OIL`: as soft as 400 MPa at 50 bar."""
