"""Generic sizes: cylinders by ISO 6020-2 and ISO 6022, valves by their nominal size.

Bores and rods are those of the standards. What stands with a valve's size is typical of what makers
offer in it, and no maker's datum.
"""

from typing import Final, NamedTuple


class ValveSize(NamedTuple):
    """A typical proportional or servo-valve.

    Attributes:
        rated_flow: through an edge of the wide open valve [l/min].
        rated_drop: over that edge [bar].
        overlap: of the spool's stroke [%].
        frequency: at which the spool lags by 90 degrees, at a small amplitude [Hz].
    """

    rated_flow: float
    rated_drop: float
    overlap: float
    frequency: float


VALVES: Final[dict[str, ValveSize]] = {
    "NG6": ValveSize(25.0, 5.0, 15.0, 60.0),
    "NG10": ValveSize(60.0, 5.0, 15.0, 40.0),
    "NG16": ValveSize(150.0, 5.0, 15.0, 30.0),
    "NG25": ValveSize(300.0, 5.0, 15.0, 20.0),
    "servo NG6": ValveSize(20.0, 35.0, 0.0, 120.0),
    "servo NG10": ValveSize(40.0, 35.0, 0.0, 100.0),
    "servo NG16": ValveSize(150.0, 35.0, 0.0, 60.0),
}
"""By nominal size: direct operated up to NG10, with a pilot above."""

CYLINDERS: Final[dict[str, dict[int, tuple[int, ...]]]] = {
    "ISO 6020-2, 160 bar": {
        25: (12, 18),
        32: (14, 22),
        40: (18, 28),
        50: (22, 28, 36),
        63: (28, 36, 45),
        80: (36, 45, 56),
        100: (45, 56, 70),
        125: (56, 70, 90),
        160: (70, 90, 110),
        200: (90, 110, 140),
    },
    "ISO 6022, 250 bar": {
        50: (32, 36),
        63: (40, 45),
        80: (50, 56),
        100: (63, 70),
        125: (80, 90),
        160: (100, 110),
        200: (125, 140),
        250: (160, 180),
        320: (200, 220),
    },
}
"""The rods of each bore [mm], by standard and its nominal pressure."""


def describe_cylinder(bore: float, rod: float) -> str:
    """Return the standards that have a bore with a rod [mm]; empty without any."""
    standards = [name for name, bores in CYLINDERS.items() if rod in bores.get(int(bore), ())]
    return " and ".join(standards) if bore == int(bore) else ""


def catalogue_lines() -> list[str]:
    """Return the catalogue as lines."""
    lines = ["valves: rated flow @ pressure drop of an edge, overlap, frequency at -90 degrees"]
    lines += [
        f"  {name:12} {each.rated_flow:g} l/min @ {each.rated_drop:g} bar, "
        f"{each.overlap:g} %, {each.frequency:g} Hz"
        for name, each in VALVES.items()
    ]
    for standard, bores in CYLINDERS.items():
        lines += ["", f"cylinders: bore/rod [mm], {standard}"]
        lines += ["  " + "  ".join(f"{bore}/{rod}" for rod in rods) for bore, rods in bores.items()]
    return lines
