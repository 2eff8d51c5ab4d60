"""The hydraulic motor as a kind of plant."""

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Final

from hil_bench.config.settings import Problems, Settings
from hil_bench.plants.hydraulic_cylinder.configuration import full_opening_mm
from hil_bench.plants.hydraulic_cylinder.quantities import P_A, P_B
from hil_bench.plants.kind import Fact, PlantKind
from hil_bench.plants.rotary.configuration import RotaryConfig, configure
from hil_bench.plants.rotary.data_sheet import apply_data_sheet, find_leftovers
from hil_bench.plants.rotary.keys import ROTARY_KEYS
from hil_bench.plants.rotary.motor import HydraulicMotor
from hil_bench.plants.rotary.plausible_ranges import POSSIBLE, USUAL
from hil_bench.plants.rotary.quantities import QUANTITIES
from hil_bench.plants.rotary.summary import find_unresolved, summarise
from hil_bench.units import MILLIMETRE


class Rotary(PlantKind[RotaryConfig]):
    """A valve-controlled hydraulic motor with an inertia and a load torque."""

    name = "rotary"
    keys = ROTARY_KEYS
    quantities = QUANTITIES
    command_unit = MILLIMETRE
    usual = USUAL
    possible = POSSIBLE
    default_nodes = MappingProxyType(
        {
            "valve": {"profile": "valve_408", "node_id": 1},
            "pressure_a": {"profile": "pressure_404", "node_id": 2, "source": P_A},
            "pressure_b": {"profile": "pressure_404", "node_id": 3, "source": P_B},
            "encoder": {"profile": "rotary_encoder_406", "node_id": 4},
        }
    )

    def configure(
        self, name: str, settings: Settings, step_us: int, problems: Problems
    ) -> RotaryConfig | None:
        """Return the record of an axis."""
        return configure(self, name, settings, step_us, problems)

    def derive(self, settings: Settings, problems: Problems) -> Settings:
        """Return the settings of an axis with what its data sheets determine."""
        return apply_data_sheet(settings, problems)

    def find_leftovers(self, settings: Settings) -> Iterator[tuple[str, str]]:
        """Yield the parts of an axis of which the file says nothing."""
        return find_leftovers(settings)

    def summarise(self, axis: RotaryConfig, tick_us: int, step_us: int) -> Sequence[Fact]:
        """Return speeds, torques, pressures, frequencies and times of an axis."""
        return summarise(axis, tick_us, step_us)

    def build(
        self, axis: RotaryConfig, dt: float, start: Mapping[str, float] | None = None
    ) -> HydraulicMotor:
        """Return the motor of an axis."""
        return HydraulicMotor(axis, dt, start or {})

    def full_scale(self, settings: Settings) -> float:
        """Return the spool position from which on the orifices are fully open [mm]."""
        return full_opening_mm(settings)

    def lowest_supply_bar(self, settings: Settings) -> float:
        """Return the pressure of the tank [bar]."""
        return float(settings["tank_pressure_bar"].value)

    def find_doubts(self, axis: RotaryConfig, tick_us: int, step_us: int) -> Iterator[str]:
        """Yield the oscillations that neither tick nor step resolves."""
        return find_unresolved(axis, tick_us, step_us)


ROTARY: Final = Rotary()
