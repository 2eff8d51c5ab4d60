"""Cushions at both ends of the stroke: near an end, oil leaves through a throttle only.

Over the first fifth of its length the plug closes the port; from there on the throttle is all that
is left. Oil flows in through a check valve, as freely as elsewhere.
"""

from hil_bench.plants.hydraulic_cylinder.model.kernel import kernel

CushionConstants = tuple[float, float, float, float]
"""(length at A's end [m], resistance of its throttle [1/m], the same at B's end); 0 for none."""

TAPER = 0.2
"""Share of a cushion's length over which its plug closes the port."""


@kernel
def cushion_resistance(distance: float, length: float, resistance: float) -> float:
    """Return the resistance of the cushion to oil that leaves a chamber [1/m].

    Args:
        distance: of the piston from the end of its stroke [m].
        length: of the cushion [m].
        resistance: of its throttle [1/m]; 0 for no cushion.
    """
    if resistance == 0.0 or distance >= length:
        return 0.0
    share = (length - distance) / (TAPER * length)
    return resistance if share > 1.0 else share * resistance


@kernel
def cushion_resistances(x: float, h: float, cushions: CushionConstants) -> tuple[float, float]:
    """Return the resistances for oil that leaves A, at -h, and B, at +h [1/m].

    Args:
        x: piston position [m].
        h: half-stroke [m].
        cushions: the constants.
    """
    return (
        cushion_resistance(h + x, cushions[0], cushions[1]),
        cushion_resistance(h - x, cushions[2], cushions[3]),
    )
