"""The hydraulic motor as a kind of plant."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final

from hil_bench.config.settings import Problems, Settings
from hil_bench.plants.hydraulic_cylinder.valve_controlled import VALVE_NODES, ValveControlled
from hil_bench.plants.kind import Fact
from hil_bench.plants.page import Page
from hil_bench.plants.quantity import Quantity
from hil_bench.plants.rotary.configuration import RotaryConfig, configure
from hil_bench.plants.rotary.data_sheet import apply_data_sheet, find_leftovers
from hil_bench.plants.rotary.keys import ROTARY_KEYS
from hil_bench.plants.rotary.motor import HydraulicMotor
from hil_bench.plants.rotary.picture import motor_page
from hil_bench.plants.rotary.quantities import QUANTITIES
from hil_bench.plants.rotary.summary import USUAL_RESULTS, find_unresolved, summarise


class Rotary(ValveControlled[RotaryConfig]):
    """A valve-controlled hydraulic motor with an inertia and a load torque."""

    name = "rotary"
    keys = ROTARY_KEYS
    quantities: tuple[Quantity, ...] = QUANTITIES
    usual_results = USUAL_RESULTS
    default_nodes = MappingProxyType(
        {**VALVE_NODES, "encoder": {"profile": "rotary_encoder_406", "node_id": 4}}
    )

    def configure(
        self, name: str, settings: Settings, step_us: int, problems: Problems
    ) -> RotaryConfig | None:
        """Return the record of an axis."""
        return configure(self, name, settings, step_us, problems)

    def derive(self, settings: Settings, problems: Problems) -> Settings:
        """Return the settings of an axis with what its data sheets determine."""
        return apply_data_sheet(settings, problems)

    def specialise(self, settings: Settings, folder: Path, problems: Problems) -> "Rotary":
        """Return the kind with the pressures at the valve, and with those of a shared supply."""
        quantities = self.see_more(self.quantities, settings)
        return self if quantities is self.quantities else SpecialRotary(quantities)

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

    def page(self, axis: RotaryConfig) -> Page:
        """Return the picture of an axis, to scale."""
        return motor_page(axis)

    def find_doubts(self, axis: RotaryConfig, tick_us: int, step_us: int) -> Iterator[str]:
        """Yield the oscillations that neither tick nor step resolves."""
        return find_unresolved(axis, tick_us, step_us)


class SpecialRotary(Rotary):
    """A motor with waves in its lines, or with a shared supply.

    Args:
        quantities: what can be seen of it.
    """

    def __init__(self, quantities: tuple[Quantity, ...]) -> None:
        self.quantities = quantities


ROTARY: Final = Rotary()
