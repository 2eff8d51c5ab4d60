"""A mass on a spring, moved by a force, as a kind of plant: m x'' + d x' + k x = F."""

from collections.abc import Mapping
from dataclasses import dataclass

from hil_bench.config.settings import Key, Problems, Settings, convert
from hil_bench.config.values import number
from hil_bench.plants.plant import AxisConfig, Influence, Page, PlantKind, Quantity, Shown
from hil_bench.units import (
    KILOGRAM,
    MILLIMETRE,
    NEWTON,
    NEWTON_PER_MILLIMETRE,
    NEWTON_SECOND_PER_METRE,
)

QUANTITIES = (
    Quantity("position", "m", 0, tolerance=1e-4, shown=Shown("x {:+8.2f} mm", 1e3)),
    Quantity("speed", "m/s", 1),
    Quantity("force_setpoint", "N", None),
    Quantity("force", "N", 2, shown=Shown("F {:+8.1f} N", 1.0)),
)

# How it looks on the page: {t} is the travel to each side [m].
PICTURE = """\
<svg viewBox="0 0 440 120">
  <path class="ground" d="M 20 30 V 90 M 20 90 H 430"/>
  <path class="thin" d="M 0 60 h 4 l 2 -14 l 4 28 l 4 -28 l 4 28 l 4 -28 l 2 14 h 4"
        transform="translate(20 0)" data-stretch="position -{t} {t} 1 13"/>
  <g data-x="position -{t} {t} 48 384"><rect class="mass" x="0" y="36" width="40" height="54"/></g>
  <text x="20" y="20" class="huge" data-text="position"/>
  <text x="430" y="20" class="right" data-text="force" data-label="force"/>
</svg>
"""


@dataclass(frozen=True, slots=True)
class SpringConfig(AxisConfig):
    """A mass on a spring; all in SI.

    Attributes:
        mass: m [kg].
        stiffness: k [N/m].
        damping: d [N s/m].
        position: x at the start [m].
        travel: largest x to each side, where a position sensor ends [m].
        force: largest force to each side, the command of 100 % [N].
    """

    mass: float
    stiffness: float
    damping: float
    position: float
    travel: float
    force: float

    @property
    def full_scale(self) -> float:
        """The largest force [N]."""
        return self.force

    @property
    def defects(self) -> tuple[Influence, ...]:
        """The share of its stiffness that the spring has lost."""
        return (Influence("lost_stiffness", "-", 0.0, 1.0),)

    def limits(self, quantity: str) -> tuple[float, float]:
        """Return the ends of the travel, for the position."""
        if quantity == "position":
            return -self.travel, self.travel
        return AxisConfig.limits(self, quantity)


class MassOnSpring:
    """The mass, moved on by semi-implicit Euler steps."""

    def __init__(self, config: SpringConfig, dt: float, start: Mapping[str, float]) -> None:
        self._config, self._dt = config, dt
        self._x = start.get("position", config.position)
        self._v = start.get("speed", 0.0)
        self._force = 0.0
        self._stiffness = config.stiffness

    @property
    def output(self) -> tuple[float, float, float]:
        """Position [m], speed [m/s] and force [N]."""
        return self._x, self._v, self._force

    def drive(self, command: float, steps: int) -> tuple[float, float, float]:
        """Move on under a force [N]."""
        config, dt = self._config, self._dt
        x, v = self._x, self._v
        for _ in range(steps):
            v += (command - config.damping * v - self._stiffness * x) / config.mass * dt
            x += v * dt
        self._x, self._v, self._force = x, v, command
        return x, v, command

    def go_to(self, values: Mapping[str, float]) -> None:
        """Go on from another position or speed."""
        self._x = values.get("position", self._x)
        self._v = values.get("speed", self._v)

    def influence(self, name: str, value: float | None) -> None:
        """Let the spring lose a share of its stiffness, the only thing that acts on it."""
        self._stiffness = self._config.stiffness * (1.0 - (value or 0.0))


class MassOnSpringKind(PlantKind[SpringConfig]):
    """A mass on a spring."""

    name = "mass_on_spring"
    keys = (
        Key("mass_kg", number(KILOGRAM, low=1e-3, high=1e6), 10.0, KILOGRAM, "mass"),
        Key(
            "stiffness_n_mm",
            number(NEWTON_PER_MILLIMETRE, low=1e-6, high=1e6),
            1.0,
            NEWTON_PER_MILLIMETRE,
            "stiffness",
        ),
        Key(
            "damping_n_s_m",
            number(NEWTON_SECOND_PER_METRE, low=0.0, high=1e6),
            0.0,
            NEWTON_SECOND_PER_METRE,
            "damping",
        ),
        Key("position_mm", number(MILLIMETRE), 0.0, MILLIMETRE, "position"),
        Key("travel_mm", number(MILLIMETRE, low=1e-3, high=1e6), 200.0, MILLIMETRE, "travel"),
        Key("force_n", number(NEWTON, low=1e-3, high=1e9), 100.0, NEWTON, "force"),
    )
    quantities = QUANTITIES
    command_unit = NEWTON

    def configure(
        self, name: str, settings: Settings, step_us: int, problems: Problems
    ) -> SpringConfig | None:
        """Return the record of an axis; a step that is too long for its swing is noted."""
        config = SpringConfig(name=name, kind=self, **convert(settings, self.keys))
        limit_us = 2e6 * (config.mass / config.stiffness) ** 0.5  # where omega dt = 2
        if step_us >= limit_us:
            place = problems.place(f"plant.{name}", "stiffness_n_mm")
            problems.add(place, f"swings too fast for step_us; give less than {limit_us:g} us")
            return None
        return config

    def build(
        self, axis: SpringConfig, dt: float, start: Mapping[str, float] | None = None
    ) -> MassOnSpring:
        """Return the mass, at rest where no speed is given to start with."""
        return MassOnSpring(axis, dt, start or {})

    def page(self, axis: SpringConfig) -> Page:
        """Return its picture, and the quantities that are plotted first."""
        return Page(PICTURE.format(t=axis.travel), ("position", "force_setpoint", "force"))

    def full_scale(self, settings: Settings) -> float:
        """Return the largest force [N]."""
        return float(settings["force_n"].value)


MASS_ON_SPRING = MassOnSpringKind()
