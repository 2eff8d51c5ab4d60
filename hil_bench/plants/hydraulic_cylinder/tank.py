"""The temperature of the oil of a shared supply: one mass of oil that is warmed and cooled.

    m c dT/dt = H - k (T - T_ambient) - k_c max(T - T_c, 0)

H is what the first law leaves: the work of the pump, with its losses, less what the pistons do on
their loads, and less what is stored in moving masses, compressed oil and gas. So throttles,
leakage, friction, relief valve and impacts all warm the oil, without a sum over them.
"""

from dataclasses import dataclass
from typing import Final

from hil_bench.plants.hydraulic_cylinder.data_sheet.oil import TEMPERATURE_C, Oil
from hil_bench.plants.hydraulic_cylinder.model.supply import OilNow

HEAT_CAPACITY: Final = 1900.0
"""A typical specific heat of mineral oil [J/(kg K)]."""

LAMINAR, VISCOUS = 0.5, 0.5
"""Typical parts of a pump's slip and of its friction at 40 °C that go with the viscosity [-]."""

_LEAST = 0.01  # of its displacement, what any pump gives

COLDEST, HOTTEST = -40.0, 120.0
"""Beyond these the laws of viscosity and density are not continued [°C]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TankConfig:
    """The oil of a supply, its tank and its cooler.

    Attributes:
        oil: its class.
        start: temperature at the start [°C].
        volume: of the oil in the tank and all that it fills [m³].
        ambient: temperature of the air [°C].
        walls: k, what the tank gives to the air [W/K].
        cooler: k_c, what the cooler takes [W/K].
        cooled_from: T_c at which the cooler begins [°C].
        efficiency: hydraulic power of the pump over that of its shaft, at 40 °C [-].
        volumetric: flow of the pump over that of its displacement, at 40 °C [-]; 1 where its
            leakage is a constant of its own.
    """

    oil: Oil
    start: float
    volume: float
    ambient: float
    walls: float
    cooler: float
    cooled_from: float
    efficiency: float
    volumetric: float = 1.0

    @property
    def capacity(self) -> float:
        """M c of the oil [J/K], with its density at 40 °C."""
        return self.volume * self.oil.density_at(TEMPERATURE_C) * HEAT_CAPACITY

    def pump_at(self, dynamic: float) -> tuple[float, float]:
        """Return the pump's flow over that at 40 °C, and its efficiency then.

        With mu over that at 40 °C, V the displacement's flow and a half each for the terms without
        viscosity, after W. M. J. Schlösser (Mathematical model for displacement pumps and motors,
        Hydraulic Power Transmission, 1961):

            Q / V = 1 - (1 - eta_v) (1 + 1 / mu) / 2,   1 / eta_hm - 1 grows with (1 + mu) / 2

        Args:
            dynamic: viscosity over that at 40 °C.
        """
        volumetric = max(self.volumetric, self.efficiency)
        slip = (1.0 - volumetric) * (1.0 - LAMINAR + LAMINAR / dynamic)
        left = max(1.0 - slip, _LEAST)
        drag = (volumetric / self.efficiency - 1.0) * (1.0 - VISCOUS + VISCOUS * dynamic)
        return left / volumetric, left / (1.0 + drag)

    def steady(self, heat: float) -> float:
        """Return the temperature at which a flow of heat [W] leaves again [°C]; infinite for none.

        Args:
            heat: H.
        """
        if self.walls > 0.0:
            warm = self.ambient + heat / self.walls
            if warm <= self.cooled_from:
                return warm
        whole = self.walls + self.cooler
        if whole <= 0.0:
            return float("inf")
        return (heat + self.walls * self.ambient + self.cooler * self.cooled_from) / whole


class Tank:
    """The oil's temperature in a run.

    Args:
        config: of the tank.

    Attributes:
        config: as passed in.
        temperature: of the oil [°C].
    """

    def __init__(self, config: TankConfig) -> None:
        self.config, self._capacity = config, config.capacity
        self.temperature = config.start

    def warm(self, heat: float, time: float) -> None:
        """Let the oil take up heat [J] over a time [s]; linearly implicit."""
        config, now = self.config, self.temperature
        lost, slope = config.walls * (now - config.ambient), config.walls
        if now > config.cooled_from:
            lost, slope = lost + config.cooler * (now - config.cooled_from), slope + config.cooler
        change = (heat - time * lost) / (self._capacity + time * slope)
        self.temperature = now + change

    def oil_now(self) -> OilNow:
        """Return the oil as it is now, over its values at 40 °C."""
        oil, now = self.config.oil, min(max(self.temperature, COLDEST), HOTTEST)
        viscosity = oil.viscosity_at(now) / oil.viscosity_at(TEMPERATURE_C)
        density = oil.density_at(now) / oil.density_at(TEMPERATURE_C)
        pure = oil.bulk_modulus * 1e6
        return OilNow(viscosity, density, oil.stiffness_at(now), pure)
