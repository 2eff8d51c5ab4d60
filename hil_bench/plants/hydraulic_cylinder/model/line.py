"""A line between valve and cylinder, as long as its waves need time."""

import math
from dataclasses import dataclass

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model.validation import require_positive

MOST_STEPS = 65_536
"""Steps that a wave may take through a line: 3 s at 50 us."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """A hose or a pipe whose waves need time.

    Attributes:
        length: of the line [m].
        inner: its inner diameter [m].
        bulk_modulus: of the oil in it with the give of its wall [Pa].
        viscosity: kinematic, of the oil [m²/s].

    Raises:
        ParameterError: for a value that makes no physical sense.
    """

    length: float
    inner: float
    bulk_modulus: float
    viscosity: float = 46e-6

    def __post_init__(self) -> None:
        for name, unit in (
            ("length", "m"),
            ("inner", "m"),
            ("bulk_modulus", "Pa"),
            ("viscosity", "m²/s"),
        ):
            require_positive(name, getattr(self, name), unit, "the line")

    @property
    def area(self) -> float:
        """Cross-section [m²]."""
        return 0.25 * math.pi * self.inner * self.inner

    @property
    def volume(self) -> float:
        """Return the volume of the line [m³]."""
        return self.area * self.length

    @property
    def compliance(self) -> float:
        """The compliance of the line, V / E [m³/Pa]."""
        return self.volume / self.bulk_modulus

    def wave_speed(self, density: float) -> float:
        """Return c = sqrt(E / rho) [m/s] for an oil of this density [kg/m³]."""
        return math.sqrt(self.bulk_modulus / density)

    def wave_time(self, density: float) -> float:
        """Return L / c, which a wave takes from end to end [s]."""
        return self.length / self.wave_speed(density)

    def impedance(self, density: float) -> float:
        """Return rho c / area, the pressure of a wave per flow [Pa s/m³]."""
        return density * self.wave_speed(density) / self.area

    def resistance(self, density: float) -> float:
        """Return the pressure drop per laminar flow, 128 rho nu L / (pi d⁴) [Pa s/m³]."""
        return 128.0 * density * self.viscosity * self.length / (math.pi * self.inner**4)

    def steps(self, density: float, dt: float) -> int:
        """Return the whole steps of `dt` [s] that come next to the wave time, at least one."""
        return max(1, round(self.wave_time(density) / dt))


def korteweg(modulus: float, inner: float, wall: float, wall_modulus: float) -> float:
    """Return the bulk modulus of oil in a thin-walled pipe that gives [Pa].

    1 / E = 1 / E_oil + d / (s E_wall): the wall's hoop strain (D. J. Korteweg, Annalen der Physik
    241, 1878; E. B. Wylie and V. L. Streeter, Fluid Transients in Systems, 1993, eq. 1-6).

    Args:
        modulus: of the oil [Pa].
        inner: inner diameter [m].
        wall: its thickness [m].
        wall_modulus: Young's modulus of the wall [Pa].
    """
    return 1.0 / (1.0 / modulus + inner / (wall * wall_modulus))


def check_line(symbol: str, line: Line | None, density: float, dt: float) -> None:
    """Refuse a line through which a wave passes within a step, or in more than `MOST_STEPS`.

    Raises:
        ParameterError: the message names the line by its symbol.
    """
    if line is None:
        return
    time = line.wave_time(density)
    if time < dt:
        raise ParameterError(
            f"{symbol} = {line.length:g} m: a wave passes it in {time * 1e6:.3g} us, within one "
            f"step of {dt * 1e6:g} us; count it as volume, or take a shorter step",
            symbol,
        )
    if time > MOST_STEPS * dt:
        raise ParameterError(
            f"{symbol} = {line.length:g} m: a wave takes {time:.3g} s through it, more than "
            f"{MOST_STEPS} steps of {dt * 1e6:g} us; give a shorter line or a longer step",
            symbol,
        )
