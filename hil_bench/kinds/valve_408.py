"""The proportional valve of CiA 408 as a kind of device."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final

from device_profiles import REGISTERS, VALVE_408
from hil_bench.canopen_device.node import Node
from hil_bench.config.settings import Key, Problems, Settings
from hil_bench.config.values import number
from hil_bench.devices.axis import Drive, Fitting
from hil_bench.devices.quantities import valve_quantities
from hil_bench.devices.valve_408 import ValveDevice
from hil_bench.kinds.kind import DeviceKind, NodeConfig, require_quantities
from hil_bench.kinds.surroundings import Surroundings
from hil_bench.plants.kind import AxisSettings
from hil_bench.units import MILLIMETRE

_COMMANDS, _SHOWS = "spool_setpoint", "spool_position"


@dataclass(frozen=True, slots=True)
class ValveConfig(NodeConfig):
    """A proportional valve (CiA 408).

    Attributes:
        full_opening: spool position at a set-point of 100 % [m].
    """

    full_opening: float


class ValveKind(DeviceKind[ValveConfig]):
    """A valve commands the spool of its axis and shows where it is."""

    name = "valve_408"
    record = ValveConfig
    eds = VALVE_408
    keys = (Key("full_opening_mm", number(MILLIMETRE), None, MILLIMETRE, "full_opening"),)
    registers = REGISTERS / "valve_408.toml"
    is_drive = has_enable_input = True
    driver = "hil_drivers:ProportionalValve"

    def check(self, table: str, node: Settings, axis: AxisSettings, problems: Problems) -> None:
        """Note a plant without a spool."""
        require_quantities(problems.place(table, "axis"), (_COMMANDS, _SHOWS), axis, problems)

    def resolve(self, node: Settings, axis: AxisSettings) -> None:
        """Take the full opening from the orifices where the table does not give it."""
        opening = node["full_opening_mm"]
        if opening.value is None:
            full = axis.kind.full_scale(axis.settings)
            node["full_opening_mm"] = opening._replace(value=full)

    def watched(self, config: ValveConfig) -> Mapping[str, str]:
        """Return the spool position."""
        return {_SHOWS: "spool_position"}

    def full_scales(self, config: ValveConfig) -> Mapping[str, float]:
        """Return the full opening [m]."""
        return {str(config.axis): config.full_opening}

    def fit(self, config: ValveConfig, node: Node, surroundings: Surroundings) -> Fitting:
        """Build the valve."""
        device = ValveDevice(node, config.full_opening)
        return Fitting(
            drives=(Drive(config.name, str(config.axis), device, device),),
            registers=partial(valve_quantities, device),
            state=lambda: device.state.value,
        )


VALVE: Final = ValveKind()
