"""The targets of a step: influences on a plant, objects, set-points of valves, J1939 signals.

And Modbus registers.
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

from hil_bench.abilities.j1939.ecus import EcuHandle
from hil_bench.abilities.j1939.kinds.auxiliary_valve import SET_POINT, AuxiliaryValveConfig
from hil_bench.abilities.modbus.binding import BoundUnit, ModbusBinding
from hil_bench.abilities.modbus.protocol.mailbox import BoundRegister
from hil_bench.abilities.modbus.protocol.register_map import ModbusException, RegisterAccess
from hil_bench.abilities.scenario.dimensions import dimension_of, show_dimension
from hil_bench.bench.commands import Controls
from hil_bench.bench.configuration import BenchConfig, NodeConfig
from hil_bench.bench.peers import peers_of
from hil_bench.bench.session import Session
from hil_bench.canopen_device.datatypes import BooleanType, DataType, IntegerType, RealType
from hil_bench.canopen_device.object_dictionary import Access, Variable
from hil_bench.config.objects import find_object, name_object, parse_object
from hil_bench.config.values import find_nearest, quote
from hil_bench.devices.kinds.registry import VALVE
from hil_bench.devices.valve_408 import REFERENCE
from hil_bench.errors import ConfigError, SdoAbort
from hil_bench.plants.plant import Influence
from hil_bench.units import ONE, si_unit

# Modbus registers by the names that scenarios give them: "modbus.valve.spool_setpoint".

MODBUS = "modbus"
"""What the names of registers begin with."""


class RegisterTarget(NamedTuple):
    """A register of a Modbus unit.

    Attributes:
        name: in scenarios.
        unit: the unit, with all its registers.
        entry: the register, and what stands behind it.
    """

    name: str
    unit: BoundUnit
    entry: BoundRegister

    def read(self) -> float:
        """Return the SI value that a client reads; NaN where there is none."""
        return self.entry.register.as_read(self.entry.read())

    @property
    def is_writable(self) -> bool:
        """Return True if clients may write it."""
        return self.unit.may_write(self.entry.register)

    def check_writable(self) -> None:
        """Refuse a register that clients may not write.

        Raises:
            ConfigError: they may not; it says why.
        """
        if self.is_writable:
            return
        if self.entry.register.access is RegisterAccess.COMMAND:
            right = f"give commands = true in [modbus.units.{self.unit.name}]"
            raise ConfigError(f"{self.name} is a command, which Modbus may not give; {right}")
        raise ConfigError(f"{self.name} is read-only; hil-bench registers says which are not")

    def check_value(self, value: float) -> None:
        """Refuse a value [SI] that the register cannot take.

        Raises:
            ConfigError: it is out of range.
        """
        unit, (low, high) = self.entry.register.unit, self.entry.register.limits
        given = unit.from_si(value)
        if not low <= given <= high:
            symbol = "" if unit is ONE else f" {unit.symbol}"
            right = f"give {low:g} to {high:g}{symbol}"
            raise ConfigError(f"{self.name}: {given:g}{symbol} is out of range; {right}")


@dataclass(frozen=True, slots=True)
class WriteRegister:
    """Write a register as a Modbus client does; a command to the door of a session.

    Attributes:
        target: the register.
        value: in SI.
    """

    target: RegisterTarget
    value: float

    def act(self, controls: Controls, now: int) -> None:  # noqa: ARG002 - Command's
        """Write it in this tick.

        Raises:
            ConfigError: the unit or its device refuses it.
        """
        target = self.target
        try:
            target.unit.write(target.entry.register, self.value, now)
        except (ModbusException, SdoAbort) as error:
            shown = target.entry.register.unit.from_si(self.value)
            raise ConfigError(f"{target.unit.name} refuses {shown:g}: {error}") from None


def name_registers(modbus: ModbusBinding | None) -> dict[str, RegisterTarget]:
    """Return the registers of all units by name; none without Modbus.

    A name that stands in several tables of its unit has the table before it:
    "modbus.valve.coils.control".
    """
    return dict(_named(modbus)) if modbus is not None else {}


def name_shared(registers: Mapping[str, RegisterTarget]) -> dict[str, str]:
    """Return the right names for each name that several tables of a unit share."""
    found: dict[str, list[str]] = {}
    for name, target in registers.items():
        short = f"{MODBUS}.{target.unit.name}.{target.entry.register.name}"
        found.setdefault(short, []).append(name)
    return {short: " or ".join(names) for short, names in found.items() if len(names) > 1}


def _named(modbus: ModbusBinding) -> Iterator[tuple[str, RegisterTarget]]:
    for unit in modbus.units:
        counts = Counter(entry.register.name for entry in unit.entries)
        for entry in unit.entries:
            register = entry.register
            is_alone = counts[register.name] == 1
            rest = register.name if is_alone else f"{register.table}.{register.name}"
            name = f"{MODBUS}.{unit.name}.{rest}"
            yield name, RegisterTarget(name, unit, entry)


ALL = "all"
"""The target of an NMT command to every node."""

_SET_POINT_OBJECT = 0x6300, 1
_REFERENCE_OBJECT = 0x6311, 1


class PlantTarget(NamedTuple):
    """An influence on a plant from outside.

    Attributes:
        axis: the name of the axis.
        influence: name, unit and limits.
    """

    axis: str
    influence: Influence


class ObjectTarget(NamedTuple):
    """An object of a node.

    Attributes:
        node: the name of the node.
        variable: the object.
        scale: what a value of 1 is in the object.
    """

    node: str
    variable: Variable
    scale: float = 1.0

    @property
    def name(self) -> str:
        """The object's name: "0x6300.01"."""
        return name_object(self.variable.index, self.variable.subindex)

    def raw(self, value: float) -> int | float | bool:
        """Return the object's raw value for a value; integers are rounded."""
        scaled = value * self.scale
        match self.variable.data_type:
            case BooleanType():
                return bool(round(scaled))
            case IntegerType():
                return round(scaled)
            case _:
                return scaled


class SignalTarget(NamedTuple):
    """A signal that a J1939 device sends.

    Attributes:
        device: the name of the device.
        name: of the signal.
        handle: the device.
    """

    device: str
    name: str
    handle: EcuHandle

    @property
    def factor(self) -> float:
        """The value of 1 of the signal's own unit in SI."""
        return si_unit(self.handle.values[self.name].unit)[1]

    def raw(self, value: float) -> float:
        """Return a value [SI] in the signal's own unit."""
        return value / self.factor


class ValveTarget(NamedTuple):
    """The set-point of a valve driver on J1939, which a controller repeats.

    Attributes:
        device: its name.
        config: its configuration.
        handle: the device.
    """

    device: str
    config: AuxiliaryValveConfig
    handle: EcuHandle


Target = PlantTarget | ObjectTarget | RegisterTarget | SignalTarget | ValveTarget


class Targets:
    """The targets of a bench, by name.

    Args:
        config: the bench.
        session: that bench, not necessarily powered on.
    """

    def __init__(self, config: BenchConfig, session: Session) -> None:
        self._axes = {axis.name: axis for axis in session.bench.axes}
        self._configs = {node.name: node for node in config.nodes}
        self._nodes = dict(zip(self._configs, session.bench.nodes, strict=True))
        self._registers = name_registers(session.bench.find(ModbusBinding))
        self._ecus = peers_of(session.bench)
        self._ecu_configs = {ecu.name: ecu for ecu in config.ecus}

    def find(self, name: str) -> Target:
        """Return the target of a name.

        Raises:
            ConfigError: there is none, and it names the nearest; or nobody may set it.
        """
        if name in self._registers:
            self._registers[name].check_writable()
            return self._registers[name]
        owner, _, rest = name.partition(".")
        if owner in self._nodes and rest[:2].lower() == "0x":
            return self._find_object(owner, rest)
        if owner in self._nodes and rest == SET_POINT and self._configs[owner].kind is VALVE:
            objects = self._nodes[owner].object_dictionary
            reference = objects.find(*_REFERENCE_OBJECT)
            full = reference.value if reference is not None else REFERENCE
            return ObjectTarget(owner, objects.variable(*_SET_POINT_OBJECT), float(full))
        if owner in self._ecus and rest in self._ecus[owner]:
            return self._find_signal(owner, rest)
        for influence in self._axes[owner].influences if owner in self._axes else ():
            if influence.name == rest:
                return PlantTarget(owner, influence)
        if owner == MODBUS and not self._registers:
            raise ConfigError(f"{quote(name)}: the bench has no Modbus; give [modbus] in its file")
        if name in (shared := name_shared(self._registers)):
            raise ConfigError(f"{quote(name)} is in several tables; give {shared[name]}")
        known = sorted(self._names())
        near = f"the nearest is {find_nearest(name, known)}, and " if known else ""
        right = f"{near}objects are NODE.0x6300.01"
        raise ConfigError(f"{quote(name)} is nothing to set here; {right}")

    def check_units(self, name: str, symbols: Iterable[str]) -> None:
        """Refuse units of another quantity than that of the target with this name.

        Raises:
            ConfigError: for the first of them; an object as such takes none, whatever it holds.
        """
        target = self.find(name)
        for symbol in symbols:
            if isinstance(target, ObjectTarget) and target.scale == 1.0:
                raise ConfigError(
                    f"{name} takes no value in {symbol}; give the number that the object holds"
                )
            check_unit(name, symbol, _unit(target))

    def check(self, target: Target, value: float) -> None:
        """Refuse a value that the target cannot have.

        Raises:
            ConfigError: it is out of range.
        """
        if isinstance(target, RegisterTarget):
            target.check_value(value)
            return
        if isinstance(target, SignalTarget):
            target.handle.check(target.name, target.raw(value))
            return
        if isinstance(target, PlantTarget):
            _, unit, low, high, _ = target.influence
        elif isinstance(target, ValveTarget):
            unit, low, high = "of full opening", -1.0, 1.0
        else:
            unit = "" if target.scale == 1.0 else "of full opening"
            low, high = (bound / target.scale for bound in _limits(target.variable))
        if not low <= value <= high:
            raise ConfigError(
                f"{value:g} is out of range; give {low:g} to {high:g} {unit}".rstrip()
            )

    def check_node(self, name: str) -> None:
        """Refuse a name that is neither a node's nor `ALL`.

        Raises:
            ConfigError: it is none; it names the nearest.
        """
        if name in self._ecus:
            raise ConfigError(f"{quote(name)} is a J1939 device, which has no NMT; reset it")
        known = [ALL, *self._nodes]
        if name not in known:
            raise ConfigError(
                f"{quote(name)} is no node; the nearest is {find_nearest(name, known)}"
            )

    def _find_signal(self, device: str, name: str) -> SignalTarget | ValveTarget:
        handle, config = self._ecus[device], self._ecu_configs[device]
        if isinstance(config, AuxiliaryValveConfig) and name == SET_POINT:
            return ValveTarget(device, config, handle)
        handle.check(name, math.nan)  # refuses what no test may set
        return SignalTarget(device, name, handle)

    def _find_object(self, node: str, name: str) -> ObjectTarget:
        try:
            key = parse_object(name)
            variable = find_object(self._nodes[node].object_dictionary, *key)
        except ValueError as error:
            raise ConfigError(f"{node}: {name} {error}") from None
        shown = f"{node}.{name_object(*key)} {quote(variable.name)}"
        if not is_number(variable.data_type):
            raise ConfigError(f"{shown} is {variable.data_type}; give an object that is a number")
        if variable.access is Access.CONST:
            raise ConfigError(f"{shown} is const; give one that can change")
        if key in bound_objects(self._configs[node]):
            raise ConfigError(f"{shown} shows the plant in each tick; disturb it by a fault")
        return ObjectTarget(node, variable)

    def _names(self) -> Iterator[str]:
        for name, config in self._configs.items():
            if config.kind is VALVE:
                yield f"{name}.{SET_POINT}"
        for name, axis in self._axes.items():
            for influence in axis.influences:
                yield f"{name}.{influence.name}"
        for name, ecu in self._ecus.items():
            if isinstance(self._ecu_configs[name], AuxiliaryValveConfig):
                yield f"{name}.{SET_POINT}"
            yield from (f"{name}.{each}" for each, value in ecu.values.items() if value.takes)
        for name, target in self._registers.items():
            if target.is_writable:
                yield name


def check_unit(name: str, symbol: str, wanted: str) -> None:
    """Refuse the unit of another quantity.

    Args:
        name: of the target, for the message.
        symbol: of the unit of the language in which a value is given.
        wanted: symbol of a unit of the quantity.

    Raises:
        ConfigError: the units do not measure the same.
    """
    dimension = dimension_of(wanted)
    if dimension_of(symbol) != dimension:
        right = f"one {show_dimension(dimension)}" if dimension else "a number, or one in %"
        raise ConfigError(f"{name} takes no value in {symbol}; give {right}")


def bound_objects(node: NodeConfig) -> set[tuple[int, int]]:
    """Return the objects of a node that show quantities of a plant."""
    return {(source.index, source.subindex) for source in node.sources}


def is_number(data_type: DataType) -> bool:
    """Return True if an object of this type holds a number."""
    return _holds_numbers(type(data_type))


@cache
def _holds_numbers(kind: type[DataType]) -> bool:
    return issubclass(kind, BooleanType | IntegerType | RealType)


def _unit(target: Target) -> str:
    match target:
        case PlantTarget():
            return target.influence.unit
        case RegisterTarget():
            return target.entry.register.unit.symbol
        case SignalTarget():
            return target.handle.values[target.name].unit or ONE.symbol
        case ObjectTarget() | ValveTarget():
            return ONE.symbol


def _limits(variable: Variable) -> tuple[float, float]:
    data_type = variable.data_type
    if isinstance(data_type, BooleanType):
        return 0.0, 1.0
    low = data_type.low if variable.low is None else variable.low
    high = data_type.high if variable.high is None else variable.high
    return (float("-inf") if low is None else low), (float("inf") if high is None else high)
