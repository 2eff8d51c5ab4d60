"""The quantities of a hydraulic motor, named as those of the cylinder where they are the same."""

from typing import Final

from hil_bench.plants.hydraulic_cylinder import quantities
from hil_bench.plants.plant import Quantity, Shown

ANGLE: Final = Quantity(
    "angle",
    "rad",
    0,
    tolerance=0.02,
    residual=0.2,
    is_anchor=True,
    shown=Shown("phi {:+z9.3f} rev", 0.15915494309189535),
)
"""Of the shaft, over all turns; a command that is late by 2 ms turns it by 0.2 rad at 950 rpm."""
SPEED: Final = Quantity("speed", "rad/s", 1, shown=Shown("n {:+z7.1f} rpm", 9.549296585513721))
TORQUE: Final = Quantity("torque", "N m", 5)
"""What the oil gives to the shaft, before friction: (P_A - P_B) D."""

QUANTITIES: Final = (
    ANGLE,
    SPEED,
    quantities.PRESSURE_A._replace(output=2),
    quantities.PRESSURE_B._replace(output=3),
    quantities.SPOOL_SETPOINT,
    quantities.SPOOL_POSITION._replace(output=4),
    TORQUE,
    quantities.FLOW_A._replace(output=6),
    quantities.FLOW_B._replace(output=7),
)

LOAD: Final = "load"
"""What acts on the shaft from outside [N m], positive against positive rotation."""
