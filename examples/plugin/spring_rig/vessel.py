"""A vessel that a valve fills, as a kind of plant: C P' = Q u - G P - Q_load.

The command u is the valve's opening as a ratio. What else it draws acts from outside, and a leak
is a defect.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from hil_bench.config.settings import Key, Problems, Settings, convert
from hil_bench.config.values import number
from hil_bench.plants.plant import AxisConfig, Influence, PlantKind, Quantity
from hil_bench.units import BAR, CUBIC_CENTIMETRE, LITRE_PER_MINUTE, Unit

CUBIC_CENTIMETRE_PER_BAR = Unit("cm³/bar", "_cm3_bar", CUBIC_CENTIMETRE.to_si(1.0) / BAR.to_si(1.0))


@dataclass(frozen=True, slots=True)
class VesselConfig(AxisConfig):
    """A vessel; all in SI.

    Attributes:
        pressure: P at the start [Pa].
        capacity: C [m³/Pa].
        flow: Q through the valve when it is fully open [m³/s].
    """

    pressure: float
    capacity: float
    flow: float

    @property
    def influences(self) -> tuple[Influence, ...]:
        """A flow that somebody else draws, at most that of the valve."""
        return (Influence("load_flow", "m³/s", 0.0, self.flow),)

    @property
    def defects(self) -> tuple[Influence, ...]:
        """A leak, whose name is the one that the fault `leak` makes: 1 l/(min bar) at most."""
        return (Influence("internal_leakage", "m³/(s Pa)", 0.0, 1e-3 / 60.0 / 1e5),)


class Vessel:
    """The vessel, moved on by explicit Euler steps."""

    def __init__(self, config: VesselConfig, dt: float, start: Mapping[str, float]) -> None:
        self._config, self._dt = config, dt
        self._pressure = start.get("pressure", config.pressure)
        self._opening = 0.0
        self._acting = {"load_flow": 0.0, "internal_leakage": 0.0}

    @property
    def output(self) -> tuple[float, float]:
        """Pressure [Pa] and opening [-], as `QUANTITIES` places them."""
        return self._pressure, self._opening

    def drive(self, command: float, steps: int) -> tuple[float, float]:
        """Move on under an opening [-]."""
        acting, flow = self._acting, self._config.flow * command
        for _ in range(steps):
            lost = acting["internal_leakage"] * self._pressure + acting["load_flow"]
            self._pressure += (flow - lost) / self._config.capacity * self._dt
        self._opening = command
        return self.output

    def go_to(self, values: Mapping[str, float]) -> None:
        """Go on from another pressure."""
        self._pressure = values.get("pressure", self._pressure)

    def influence(self, name: str, value: float | None) -> None:
        """Let a flow be drawn [m³/s], or oil leak [m³/(s Pa)]; None for what it was: nothing."""
        self._acting[name] = value or 0.0


class VesselKind(PlantKind[VesselConfig]):
    """A vessel behind a valve."""

    name = "vessel"
    keys = (
        Key("pressure_bar", number(BAR), 50.0, BAR, "pressure"),
        Key(
            "capacity_cm3_bar",
            number(CUBIC_CENTIMETRE_PER_BAR, low=1e-3, high=1e6),
            1.0,
            CUBIC_CENTIMETRE_PER_BAR,
            "capacity",
        ),
        Key(
            "flow_l_min",
            number(LITRE_PER_MINUTE, low=1e-3, high=1e4),
            6.0,
            LITRE_PER_MINUTE,
            "flow",
        ),
    )
    quantities = (
        Quantity("pressure", "Pa", 0, tolerance=1e5),
        Quantity("opening_setpoint", "-", None),
        Quantity("opening", "-", 1),
    )

    def configure(
        self, name: str, settings: Settings, step_us: int, problems: Problems
    ) -> VesselConfig:
        """Return the record of an axis."""
        return VesselConfig(name=name, kind=self, **convert(settings, self.keys))

    def build(
        self, axis: VesselConfig, dt: float, start: Mapping[str, float] | None = None
    ) -> Vessel:
        """Return the vessel, at the pressure that is given to start with."""
        return Vessel(axis, dt, start or {})


VESSEL = VesselKind()
