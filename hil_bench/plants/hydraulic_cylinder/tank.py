"""The temperature of the oil of a shared supply: one mass of oil that is warmed and cooled.

    m c dT/dt = H - k (T - T_ambient) - k_c max(T - T_c, 0)

H is what the first law leaves: the work of the pump, with its losses, less what the pistons do on
their loads, and less what is stored in moving masses, compressed oil and gas. So throttles,
leakage, friction, relief valve and impacts all warm the oil, without a sum over them.
"""

from dataclasses import dataclass
from typing import Final

from hil_bench.plants.hydraulic_cylinder.data_sheet.oil import TEMPERATURE_C, Oil

HEAT_CAPACITY: Final = 1900.0
"""A typical specific heat of mineral oil [J/(kg K)]."""

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
        efficiency: hydraulic power of the pump over that of its shaft [-].
    """

    oil: Oil
    start: float
    volume: float
    ambient: float
    walls: float
    cooler: float
    cooled_from: float
    efficiency: float

    @property
    def capacity(self) -> float:
        """M c of the oil [J/K], with its density at 40 °C."""
        return self.volume * self.oil.density_at(TEMPERATURE_C) * HEAT_CAPACITY

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
        temperature: of the oil [°C].
        heated: what the oil has taken up so far [J].
        cooled: what it has given away [J].
    """

    def __init__(self, config: TankConfig) -> None:
        self._config, self._capacity = config, config.capacity
        self.temperature = config.start
        self.heated = self.cooled = 0.0

    def warm(self, heat: float, time: float) -> None:
        """Let the oil take up heat [J] over a time [s]; linearly implicit."""
        config, now = self._config, self.temperature
        lost, slope = config.walls * (now - config.ambient), config.walls
        if now > config.cooled_from:
            lost, slope = lost + config.cooler * (now - config.cooled_from), slope + config.cooler
        change = (heat - time * lost) / (self._capacity + time * slope)
        self.heated += heat
        self.cooled += heat - self._capacity * change
        self.temperature = now + change

    def oil_now(self) -> tuple[float, float]:
        """Return kinematic viscosity and density over those at 40 °C."""
        oil, now = self._config.oil, min(max(self.temperature, COLDEST), HOTTEST)
        viscosity = oil.viscosity_at(now) / oil.viscosity_at(TEMPERATURE_C)
        return viscosity, oil.density_at(now) / oil.density_at(TEMPERATURE_C)
