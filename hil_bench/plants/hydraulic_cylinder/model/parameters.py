"""The plant's parameters: the paper's symbols, checked, with Table I as the default set."""

import math
from dataclasses import dataclass

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.model.extensions import ATMOSPHERE
from hil_bench.plants.hydraulic_cylinder.model.options import PlantOptions
from hil_bench.plants.hydraulic_cylinder.model.validation import ROWS, require_fields

_KEYS = ROWS.groups["parameters"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantParameters:
    """Parameters of the valve-controlled cylinder, SI units (Ruderman 2017, Table I).

    Pressures are gauge pressures, relative to the atmosphere.

    Attributes:
        alpha: orifice state at which the valve is fully open, eq. (2) [m].
        beta: dead-zone of the closed-centre spool, each side of the centre, eq. (2) [m].
        omega_0: eigenfrequency of the spool's position loop, eq. (1) [rad/s].
        xi: damping ratio of the spool's position loop, eq. (1) [-].
        C_d: discharge coefficient of the orifice, eq. (7) [-].
        w: width of the rectangular orifice area, eq. (7) [m].
        rho: density of the oil, eq. (7) [kg/m³].
        E: effective bulk modulus of the oil, eqs. (8), (9) [Pa].
        P_S: supply pressure, eqs. (5), (6) [Pa].
        P_T: tank pressure, eqs. (5), (6) [Pa].
        C_L: internal leakage coefficient, eqs. (8), (9) [m³/(s Pa)]; Table I misprints the unit.
        A_A: effective piston area of chamber A, eq. (8) [m²].
        A_B: effective piston area of chamber B, eq. (9) [m²].
        V_A0: volume of circuit A, pipes included, at x = 0, eq. (10) [m³].
        V_B0: volume of circuit B, pipes included, at x = 0, eq. (11) [m³].
        m: moving mass, eq. (12) [kg].
        F_c: Coulomb friction, eq. (13) [N].
        F_s: Stribeck (stiction) friction, eq. (13) [N].
        sigma: viscous friction coefficient, eq. (13) [N s/m].
        chi: Stribeck velocity, eq. (13) [m/s].
        delta: Stribeck exponent, eq. (13) [-].
        h: half of the stroke, eqs. (10), (11) [m].

    Raises:
        ParameterError: for a value that makes no physical sense; the message names the symbol.
    """

    alpha: float
    beta: float
    omega_0: float
    xi: float
    C_d: float
    w: float
    rho: float
    E: float
    P_S: float
    P_T: float
    C_L: float
    A_A: float
    A_B: float
    V_A0: float
    V_B0: float
    m: float
    F_c: float
    F_s: float
    sigma: float
    chi: float
    delta: float
    h: float

    def __post_init__(self) -> None:
        require_fields(self, _KEYS)
        self._check_relations()

    def _check_relations(self) -> None:
        if self.P_T < -ATMOSPHERE:
            raise ParameterError(
                f"P_T = {self.P_T:g} Pa: must be at least {-ATMOSPHERE:g} Pa, absolute vacuum",
                "P_T",
            )
        if self.P_S <= self.P_T:
            raise ParameterError(
                f"P_S = {self.P_S:g} Pa: must be greater than P_T = {self.P_T:g} Pa",
                "P_S",
                "P_T",
            )
        if self.F_s < self.F_c:
            raise ParameterError(
                f"F_s = {self.F_s:g} N: must be at least F_c = {self.F_c:g} N", "F_s", "F_c"
            )
        for volume, area in (("V_A0", "A_A"), ("V_B0", "A_B")):
            swept = getattr(self, area) * self.h
            if getattr(self, volume) <= swept:
                raise ParameterError(
                    f"{volume} = {getattr(self, volume):g} m³: must be greater than "
                    f"{area} h = {swept:g} m³, or the chamber is empty before the stroke ends",
                    volume,
                    area,
                    "h",
                )

    @property
    def K(self) -> float:  # noqa: N802 - the paper's symbol
        """Valve flow coefficient C_d w sqrt(2 / rho), eq. (7) [m²/s per sqrt(Pa)]."""
        return self.C_d * self.w * math.sqrt(2.0 / self.rho)

    @property
    def mean_area(self) -> float:
        """Mean of both piston areas, eq. (16) [m²]."""
        return 0.5 * (self.A_A + self.A_B)

    @property
    def total_volume(self) -> float:
        """Total volume of oil V_t = V_A0 + V_B0, eq. (16) [m³]."""
        return self.V_A0 + self.V_B0

    @property
    def omega_c(self) -> float:
        """Eigenfrequency of the cylinder at mid-stroke, eq. (19) [rad/s]."""
        return 2.0 * self.mean_area * math.sqrt(self.E / (self.total_volume * self.m))

    @property
    def zeta(self) -> float:
        """Damping ratio of the cylinder by viscous friction alone, eq. (20) [-]."""
        return (
            self.sigma / (4.0 * self.mean_area) * math.sqrt(self.total_volume / (self.E * self.m))
        )

    @property
    def full_opening(self) -> float:
        """Spool position alpha + beta at which the orifice is fully open, eq. (2) [m]."""
        return self.alpha + self.beta


def paper_parameters() -> PlantParameters:
    """Return Table I of Ruderman 2017."""
    return PlantParameters(
        alpha=1e-3,
        beta=3e-4,
        omega_0=1200.0,
        xi=0.7,
        C_d=0.65,
        w=0.02,
        rho=850.0,
        E=1e8,
        P_S=1e7,
        P_T=0.0,
        C_L=0.0,
        A_A=5e-3,
        A_B=4.7e-3,
        V_A0=1.2e-3,
        V_B0=1.15e-3,
        m=20.0,
        F_c=600.0,
        F_s=900.0,
        sigma=2000.0,
        chi=0.02,
        delta=0.8,
        h=0.2,
    )


# The largest step at which the midpoint rule follows the piston's swing on the oil.
#
# It stands apart from `model.stability`, the limits of explicit solvers, since that needs
# NumPy. The linearly implicit midpoint rule is stable at every step, so it has no other limit.


RESOLUTION = 1.0
"""Largest frequency of a swing times step: then a period has six steps."""


def largest_midpoint_step(parameters: PlantParameters, options: PlantOptions) -> float:
    """Return the largest step at which the midpoint rule follows the piston's swing on the oil [s].

    It is stable beyond, but what it shows is no motion of the model: at `RESOLUTION` the swing's
    frequency comes out 7 % low, at ten times that 73 %.
    """
    p = parameters
    stiffness = max(
        p.E * (p.A_A**2 / (p.V_A0 + p.A_A * x) + p.A_B**2 / (p.V_B0 - p.A_B * x))
        for x in (-p.h, p.h)
    )
    return _resolution_limit(stiffness, parameters, options)


def largest_reduced_midpoint_step(parameters: PlantParameters, options: PlantOptions) -> float:
    """Return the same for the reduced model [s]."""
    p = parameters
    return _resolution_limit(4.0 * p.E * p.mean_area**2 / p.total_volume, parameters, options)


def _resolution_limit(
    stiffness: float, parameters: PlantParameters, options: PlantOptions
) -> float:
    """Return `RESOLUTION` over the frequency of the sliding piston on the oil [s]."""
    m = parameters.m + options.load_mass
    square = stiffness / m - (0.5 * parameters.sigma / m) ** 2
    return RESOLUTION / math.sqrt(square) if square > 0.0 else math.inf
