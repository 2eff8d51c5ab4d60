"""The filter of a supply unit, between its pump with the relief valve and the line to the valves.

    D(Q) = min(R Q, P_by),   R = dp_N / Q_N nu / nu_N

is its pressure drop: the element is passed laminarly, so the drop of its data sheet goes with flow
and viscosity, until the bypass opens and holds it. Dirt blocks a share s of the element and leaves
the flow to the rest of it, R / (1 - s).
"""

import math
from dataclasses import dataclass, replace
from typing import Final

from hil_bench.plants.hydraulic_cylinder.model.validation import require_positive

_OPEN: Final = 1e-6
"""What the dirt leaves open of an element."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Filter:
    """A pressure filter behind the pump.

    Attributes:
        resistance: R, drop per flow of the clean element in this oil [Pa s/m³].
        bypass: P_by, the drop that the bypass holds [Pa]; infinite without one.

    Raises:
        ParameterError: for a value that is not positive.
    """

    resistance: float
    bypass: float = math.inf

    def __post_init__(self) -> None:
        require_positive("resistance", self.resistance, "Pa s/m³", "the filter")
        if self.bypass != math.inf:
            require_positive("bypass", self.bypass, "Pa", "the filter")

    def clogged(self, share: float) -> "Filter":
        """Return the filter with a share of its element blocked."""
        return replace(self, resistance=self.resistance / max(1.0 - share, _OPEN))

    def drop(self, flow: float) -> float:
        """Return the pressure drop [Pa] of a flow [m³/s]."""
        return min(self.resistance * flow, self.bypass)
