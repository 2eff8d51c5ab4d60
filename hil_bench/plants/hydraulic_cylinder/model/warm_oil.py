"""The influence of the oil's temperature on the constants of a plant's equations."""

from dataclasses import replace
from typing import Final, NamedTuple

from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.parameters import PlantParameters
from hil_bench.plants.hydraulic_cylinder.model.waves import Line


class OilNow(NamedTuple):
    """An oil at its temperature.

    Attributes:
        viscosity: kinematic, over that of the parameters.
        density: over that of the parameters; lines with waves keep theirs, with their wave time.
        stiffness: bulk modulus of the pure oil, over that of the parameters.
        pure: that bulk modulus at the temperature of the parameters [Pa].
    """

    viscosity: float = 1.0
    density: float = 1.0
    stiffness: float = 1.0
    pure: float = 1.4e9

    @property
    def dynamic(self) -> float:
        """Dynamic viscosity over that of the parameters."""
        return self.viscosity * self.density

    def modulus(self, E: float) -> float:
        """Return the bulk modulus [Pa] that was E [Pa]: of its compliance the oil's part changes.

        What hoses and air add to 1 / E stays as it is.
        """
        own = min(1.0 / E, 1.0 / self.pure)
        return 1.0 / (1.0 / E + own * (1.0 / self.stiffness - 1.0))


AS_GIVEN: Final = OilNow()
"""The oil of the parameters."""


def warmed(
    parameters: PlantParameters, options: PlantOptions, oil: OilNow
) -> tuple[PlantParameters, PlantOptions]:
    """Return a plant with warmer or colder oil: what leaks, shears, is throttled or compressed.

    Args:
        parameters: of the plant.
        options: of the plant.
        oil: as it is now.
    """
    if oil == AS_GIVEN:
        return parameters, options
    density = 1.0 if options.has_lines else oil.density
    dynamic = oil.viscosity * density
    parameters = replace(
        parameters,
        C_L=parameters.C_L / dynamic,
        sigma=parameters.sigma * dynamic,
        rho=parameters.rho * density,
        E=oil.modulus(parameters.E),
    )
    options = replace(
        options,
        C_LA=options.C_LA / dynamic,
        C_LB=options.C_LB / dynamic,
        line_a=_thin(options.line_a, oil.viscosity),
        line_b=_thin(options.line_b, oil.viscosity),
    )
    return parameters, options


def _thin(line: Line | None, viscosity: float) -> Line | None:
    return None if line is None else replace(line, viscosity=line.viscosity * viscosity)
