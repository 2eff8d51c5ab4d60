"""The driver of a proportional valve on J1939 (ISO 11783-7) as a kind of device."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from hil_bench.abilities.j1939.kinds.ecu import EcuConfig, EcuFitting, EcuKind, EcuMessage
from hil_bench.abilities.j1939.protocol.auxiliary_valve import (
    COMMAND,
    ESTIMATED_FLOW,
    HIGHEST_NUMBER,
    PERIOD,
    AuxiliaryValve,
)
from hil_bench.abilities.j1939.protocol.ecu import Ecu
from hil_bench.abilities.j1939.protocol.signals import EcuValue
from hil_bench.config.settings import CLOCK_MILLISECOND, Key, Problems, Settings
from hil_bench.config.values import integer, zero_or
from hil_bench.devices.axis import Drive, Fitting, Measurement
from hil_bench.devices.kinds.bindings import Surroundings
from hil_bench.devices.kinds.valve_408 import (
    FULL_OPENING,
    check_command,
    resolve_opening,
    scale_of,
)
from hil_bench.plants.plant import AxisSettings, Quantity
from hil_bench.units import ONE

FLOW: Final = Quantity("flow", ONE.symbol, 0)
"""What a valve driver says that flows, as a part of the full flow."""

SET_POINT: Final = "spool_setpoint"
"""What a valve driver is commanded, as a part of its full opening."""


@dataclass(frozen=True, slots=True)
class AuxiliaryValveConfig(EcuConfig):
    """A valve driver.

    Attributes:
        axis: the axis whose spool it moves.
        number: of the valve, 0 to 15.
        full_opening: spool position of 100 % [m]; None where the plant's command is no length.
        timeout: longest time between two commands [ns]; 0 for any.
    """

    axis: str
    number: int
    full_opening: float | None
    timeout: int


class AuxiliaryValveKind(EcuKind[AuxiliaryValveConfig]):
    """A valve driver commands the spool of its axis and says where it is."""

    name = "auxiliary_valve"
    record = AuxiliaryValveConfig
    keys = (
        Key("valve", integer(0, HIGHEST_NUMBER), 0, field="number"),
        FULL_OPENING,
        Key("timeout_ms", zero_or(integer(10, 60_000)), 300, CLOCK_MILLISECOND, "timeout"),
    )
    has_axis = True

    def check(self, table: str, device: Settings, axis: AxisSettings, problems: Problems) -> None:
        """Note a plant that no valve commands."""
        check_command(table, device, axis, problems)

    def resolve(self, device: Settings, axis: AxisSettings) -> None:
        """Take the full opening from the plant where the table does not give it."""
        resolve_opening(device, axis)

    def messages(self, config: AuxiliaryValveConfig) -> tuple[EcuMessage, ...]:
        """Return the command and the flow (ISO 11783-7)."""
        return (
            EcuMessage(COMMAND + config.number, False, 0, ("command",)),
            EcuMessage(ESTIMATED_FLOW + config.number, True, PERIOD, ("estimated flow",)),
        )

    def axis_of(self, config: AuxiliaryValveConfig) -> str | None:
        """Return the axis whose spool it moves."""
        return config.axis

    def full_scales(self, config: AuxiliaryValveConfig) -> Mapping[str, float]:
        """Return the full opening [m], where there is one."""
        return scale_of(config.axis, config.full_opening)

    def fit(self, config: AuxiliaryValveConfig, ecu: Ecu, surroundings: Surroundings) -> EcuFitting:
        """Build the valve driver."""
        full = surroundings.full_scales[config.axis]
        device = AuxiliaryValve(ecu, config.number, full_opening=full, timeout=config.timeout)
        flow = Measurement(device.show, FLOW, name=f"{config.name}.{FLOW.name}")
        fitting = Fitting(
            drives=(Drive(config.name, config.axis, device),),
            sensors=((None, flow),),
            advance=lambda now: flow.take((device.position,), now),
        )
        values = {
            SET_POINT: EcuValue(lambda: device.setpoint, ONE.symbol),
            FLOW.name: EcuValue(lambda: device.flow, ONE.symbol),
        }
        return EcuFitting(fitting, values=values)


AUXILIARY_VALVE: Final = AuxiliaryValveKind()
