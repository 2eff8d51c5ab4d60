"""The proportional valve of CiA 408 as a kind of device, and what commands any spool."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, TypeVar

from device_profiles import REGISTERS, VALVE_408
from hil_bench.canopen_device.node import Node
from hil_bench.config.settings import Key, Problems, Settings
from hil_bench.config.values import describe, number, text
from hil_bench.devices.axis import Drive, Fitting, Measurement, Rate
from hil_bench.devices.kinds.bindings import Surroundings
from hil_bench.devices.kinds.kind import DeviceKind, NodeConfig
from hil_bench.devices.kinds.pressure_404 import check_pressure
from hil_bench.devices.valve_408 import ValveDevice
from hil_bench.plants.plant import AxisSettings
from hil_bench.units import BAR, MILLIMETRE, UNITS_OF

# Common parts of the kinds of devices that command the spool of their axis.


FULL_OPENING: Final = Key(
    "full_opening_mm", number(MILLIMETRE, low=0.001, high=1000.0), None, MILLIMETRE, "full_opening"
)
"""The key of the spool position at 100 %."""


@dataclass(frozen=True, slots=True)
class SpoolConfig(NodeConfig):
    """A device that commands a spool.

    Attributes:
        full_opening: spool position of 100 % [m]; None where the plant's command is no length.
    """

    full_opening: float | None


SpoolT = TypeVar("SpoolT", bound=SpoolConfig)


class SpoolKind(DeviceKind[SpoolT]):
    """A device that commands a spool; `FULL_OPENING` is among its keys."""

    is_drive = True

    def resolve(self, node: Settings, axis: AxisSettings) -> None:
        """Take the full opening from the plant where the table does not give it."""
        resolve_opening(node, axis)

    def full_scales(self, config: SpoolT) -> Mapping[str, float]:
        """Return the full opening [m], where there is one."""
        return scale_of(str(config.axis), config.full_opening)


def check_command(table: str, node: Settings, axis: AxisSettings, problems: Problems) -> None:
    """Note a plant that no valve commands, and a full opening where the command is no length."""
    kind = axis.kind
    if not kind.takes_valve:
        right = "give the node another profile or another axis"
        what = f"the plant is a {kind.name}, commanded in {kind.command.unit}, and no valve does so"
        problems.add(problems.place(table, "axis"), f"{what}; {right}")
    elif not _is_length(axis) and node[FULL_OPENING.name].value is not None:
        what = f"a {kind.name} is commanded in {kind.command_unit.symbol}; leave the key out"
        problems.add(problems.place(table, FULL_OPENING.name), what)


def resolve_opening(node: Settings, axis: AxisSettings) -> None:
    """Take the full opening from a plant that has one, where the table does not give it."""
    opening = node[FULL_OPENING.name]
    if opening.value is None and _is_length(axis):
        full = axis.kind.command_unit.to_si(axis.kind.full_scale(axis.settings))
        node[FULL_OPENING.name] = opening._replace(value=MILLIMETRE.from_si(full))


def scale_of(axis: str, full_opening: float | None) -> Mapping[str, float]:
    """Return a full opening [m] by its axis; without one the plant's own full scale counts."""
    return {} if full_opening is None else {axis: full_opening}


def _is_length(axis: AxisSettings) -> bool:
    return axis.kind.command_unit in UNITS_OF["m"]


_PASCAL, _PRESSURE = "Pa", "pressure_source"
_METRE, _POSITION, _SPEED = "m", "position_source", "speed"
_SHOWS = "spool_position"


@dataclass(frozen=True, slots=True)
class ValveConfig(SpoolConfig):
    """A proportional valve (CiA 408).

    Attributes:
        pressure_source: the pressure that its own sensor measures; None for a valve without one.
        pressure: what stands for 100 % of pressure, the end of that sensor's range [Pa].
        position_source: the position that its own sensor measures; None for a valve without one.
    """

    pressure_source: str | None
    pressure: float
    position_source: str | None


class ValveKind(SpoolKind[ValveConfig]):
    """A valve commands the spool of its axis and shows where it is."""

    name = "valve_408"
    record = ValveConfig
    eds = VALVE_408
    keys = (
        FULL_OPENING,
        Key(_PRESSURE, text),
        Key("pressure_bar", number(BAR, low=1.0, high=1e4), 250.0, BAR, "pressure"),
        Key(_POSITION, text),
    )
    registers = REGISTERS / "valve_408.toml"
    has_enable_input = True
    driver = "hil_drivers:ProportionalValve"

    def check(self, table: str, node: Settings, axis: AxisSettings, problems: Problems) -> None:
        """Note a plant that no valve commands."""
        check_command(table, node, axis, problems)
        if node[_PRESSURE].value is not None:
            check_pressure(table, _PRESSURE, node, axis, problems)
        if node[_POSITION].value is not None:
            _check_position(table, node, axis, problems)

    def signals(self, name: str, node: Settings) -> Mapping[str, str]:
        """Return the signals of its own sensors, with their SI units."""
        units = {f"{name}.pressure": (_PRESSURE, _PASCAL), f"{name}.position": (_POSITION, _METRE)}
        return {
            signal: unit for signal, (key, unit) in units.items() if node[key].value is not None
        }

    def watched(self, config: ValveConfig) -> Mapping[str, str]:
        """Return the spool position."""
        return {_SHOWS: "spool_position"}

    def fit(self, config: ValveConfig, node: Node, surroundings: Surroundings) -> Fitting:
        """Build the valve."""
        axis = str(config.axis)
        device = ValveDevice(node, surroundings.full_scales[axis])
        kind = surroundings.axes[axis].kind
        sensors: list[tuple[str, Measurement]] = []
        if config.pressure_source is not None:
            first = kind.outputs_in(_PASCAL)[0].name  # port A: a positive spool fills it
            sense = 1 if config.pressure_source == first else -1
            device.pressure_control.fit_sensor(config.pressure, sense)
            quantity = kind.by_name[config.pressure_source]
            name = f"{config.name}.pressure"
            sensors.append((axis, Measurement(device.measure_pressure, quantity, name=name)))
        if config.position_source is not None:
            device.position_control.is_fitted = True
            quantity, speed = kind.by_name[config.position_source], kind.by_name[_SPEED]
            name = f"{config.name}.position"
            rate = Rate(_SPEED, speed, ())
            sensor = Measurement(device.measure_position, quantity, name=name, rate=rate)
            sensors.append((axis, sensor))
        return Fitting(
            drives=(Drive(config.name, axis, device, device),),
            sensors=tuple(sensors),
            state=lambda: device.state.value,
        )


def _check_position(table: str, node: Settings, axis: AxisSettings, problems: Problems) -> None:
    source = node[_POSITION].value
    known = [quantity.name for quantity in axis.kind.outputs_in(_METRE)]
    if source not in known or _SPEED not in axis.kind.by_name:
        names = ", ".join(f'"{name}"' for name in known)
        right = f"give {names}" if names else f"a {axis.kind.name} has no position"
        problems.add(problems.place(table, _POSITION), f"{describe(source)} is unknown; {right}")


VALVE: Final = ValveKind()
