"""Bindings in ``[nodes.NAME.objects]``: objects that show the plant, or command it.

``"0x6401.01" = { source = "axis1.P_A", unit = "bar", scale = 100 }`` writes a quantity to an
object, ``"0x6411.01" = { sink = "axis1.spool_setpoint", scale = 16384 }`` commands a spool by one.
In both, value of the object = quantity in `unit` × `scale` + `offset`.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final, NamedTuple

from hil_bench.canopen_device.datatypes import IntegerType, RealType
from hil_bench.canopen_device.object_dictionary import Access, ObjectDictionary, Variable
from hil_bench.config.axes import full_opening_mm
from hil_bench.config.chains import build_chain, check_chain, read_chain
from hil_bench.config.choices import Profile, Quantity
from hil_bench.config.keys import CHAIN_TABLE, SINK_KEYS, SOURCE_KEYS
from hil_bench.config.records import SinkConfig, SourceConfig
from hil_bench.errors import ConfigError
from hil_bench.measurement.parameters import ChainParameters
from hil_bench.tables.document import give
from hil_bench.tables.objects import find_object, parse_object
from hil_bench.tables.settings import Given, Origin, Problems, Settings, read_table
from hil_bench.tables.values import describe, find_nearest, quote
from hil_bench.units import (
    BAR,
    CUBIC_METRE_PER_SECOND,
    LITRE_PER_MINUTE,
    MEGAPASCAL,
    METRE,
    METRE_PER_SECOND,
    MILLIMETRE,
    MILLIMETRE_PER_SECOND,
    ONE,
    PASCAL,
    PERCENT,
    Unit,
)

_LENGTH, _SPEED = (METRE, MILLIMETRE), (METRE_PER_SECOND, MILLIMETRE_PER_SECOND)
_PRESSURE, _FLOW = (PASCAL, BAR, MEGAPASCAL), (CUBIC_METRE_PER_SECOND, LITRE_PER_MINUTE)
_SHARE = (ONE, PERCENT)

UNITS: Final[Mapping[Quantity, tuple[Unit, ...]]] = MappingProxyType(
    {
        Quantity.POSITION: _LENGTH,
        Quantity.SPEED: _SPEED,
        Quantity.P_A: _PRESSURE,
        Quantity.P_B: _PRESSURE,
        Quantity.Q_A: _FLOW,
        Quantity.Q_B: _FLOW,
        Quantity.SPOOL_POSITION: _SHARE,
        Quantity.SPOOL_SETPOINT: _SHARE,
    }
)
"""The units in which a quantity may be given, that of the SI first."""

CHAIN_PROFILES: Final[Mapping[Quantity, Profile]] = MappingProxyType(
    {
        Quantity.P_A: Profile.PRESSURE_404,
        Quantity.P_B: Profile.PRESSURE_404,
        Quantity.POSITION: Profile.ENCODER_406,
    }
)
"""The sensors whose measuring chain a source of a quantity may have."""

_SINKS = (Quantity.SPOOL_SETPOINT,)
_SOURCES = tuple(quantity for quantity in Quantity if quantity not in _SINKS)

_FIRST_BINDABLE = 0x2000
_HINT = 'give source = "AXIS.P_A" or sink = "AXIS.spool_setpoint"'


class Binding(NamedTuple):
    """A binding whose keys are right by themselves.

    Attributes:
        node: the node.
        name: the object, as in ``0x6401.01``.
        axis: the axis whose quantity it is.
        quantity: what the object is bound to.
        unit: the unit that its numbers are in.
        settings: the values of its keys.
        chain: those of its measuring chain, None where it has none.
    """

    node: str
    name: str
    axis: str
    quantity: Quantity
    unit: Unit
    settings: Settings
    chain: Settings | None

    @property
    def table(self) -> str:
        """The table that gives it."""
        return f"nodes.{self.node}.objects.{self.name}"

    @property
    def is_sink(self) -> bool:
        """Whether the object commands the plant."""
        return self.quantity in _SINKS


def read_bindings(
    nodes: Mapping[str, Settings], axes: Mapping[str, Settings], problems: Problems
) -> list[Binding]:
    """Return the bindings of all nodes; one with a problem is noted and left out."""
    found = []
    for node, settings in nodes.items():
        objects = settings["objects"].value if "objects" in settings else None
        for name, given in (objects or {}).items():
            if isinstance(given, dict):
                found.append(_read_binding(node, name, given, axes, problems))
    return [binding for binding in found if binding is not None]


def build_bindings(
    bindings: Sequence[Binding],
    nodes: Mapping[str, Settings],
    axes: Mapping[str, Settings],
    problems: Problems,
) -> dict[str, list[SourceConfig | SinkConfig]]:
    """Return the records of the bindings by their node; a sink where none can be is noted."""
    built: dict[str, list[SourceConfig | SinkConfig]] = {name: [] for name in nodes}
    for binding in bindings:
        if binding.is_sink and nodes[binding.node]["profile"].value is not Profile.GENERIC:
            wrong = f"nodes.{binding.node} does what its profile says"
            right = "give the sink to a node without a profile"
            problems.add(problems.place(binding.table, "sink"), f"{wrong}; {right}")
        if binding.chain is not None:
            check_chain(f"{binding.table}.{CHAIN_TABLE}", binding.chain, problems)
        place = problems.place(binding.table)
        built[binding.node].append(_build_binding(binding, axes[binding.axis], place))
    return built


def find_bound(object_dictionary: ObjectDictionary, binding: SourceConfig | SinkConfig) -> Variable:
    """Return the object that a binding speaks of.

    Raises:
        ConfigError: it is not there, or is of a kind that cannot be bound so.
    """
    try:
        variable = find_object(object_dictionary, binding.index, binding.subindex)
    except ValueError as error:
        raise ConfigError(f"{binding.place}: {error}") from None
    if refusal := _refusal(variable, binding):
        raise ConfigError(f"{binding.place}: {quote(variable.name)} is {refusal}")
    return variable


def _read_binding(
    node: str,
    name: str,
    given: Mapping[str, object],
    axes: Mapping[str, Settings],
    problems: Problems,
) -> Binding | None:
    table = f"nodes.{node}.objects.{name}"
    words = given.keys() & {"source", "sink"}
    if len(words) != 1:
        wrong = "is both a source and a sink" if words else "is bound to nothing"
        problems.add(problems.place(table), f"{wrong}; {_HINT}")
        return None
    if parse_object(name)[0] < _FIRST_BINDABLE:
        wrong = "belongs to the communication services"
        problems.add(problems.place(table), f"{wrong}; bind an object from 0x2000 up")
    (word,) = words
    keys = SINK_KEYS if word == "sink" else SOURCE_KEYS
    values = give(table, given, Origin.FILE, problems)
    given_chain = values.pop(CHAIN_TABLE, None)
    settings = read_table(table, values, keys, problems)
    key = word
    try:
        axis, quantity = _find_quantity(settings[key].value, axes, word)
        key = "unit"
        unit = _find_unit(settings[key].value, quantity)
    except KeyError:
        return None  # its key has a problem, which is noted already
    except ConfigError as error:
        problems.add(problems.place(table, key), error)
        return None
    chain = None
    if given_chain is not None:
        chain = _read_chain(table, quantity, given_chain, problems)
    return Binding(node, name, axis, quantity, unit, settings, chain)


def _read_chain(
    table: str, quantity: Quantity, given: Given, problems: Problems
) -> Settings | None:
    """Return the settings of a source's measuring chain, None where there is a problem."""
    if quantity not in CHAIN_PROFILES:
        problems.add(given.place, f"is for pressures and positions; {quantity} has none")
        return None
    return read_chain(table, CHAIN_PROFILES[quantity], given, problems)


def _build_binding(binding: Binding, axis: Settings, place: str) -> SourceConfig | SinkConfig:
    index, subindex = parse_object(binding.name)
    settings, unit = binding.settings, binding.unit
    common = (
        *(index, subindex, binding.axis, binding.quantity),
        *(settings["scale"].value / unit.factor, settings["offset"].value, place),
    )
    if binding.is_sink:
        full_opening = MILLIMETRE.to_si(full_opening_mm(axis))
        return SinkConfig(*common, unit.to_si(settings["safe"].value), full_opening)
    chain = ChainParameters()
    if binding.chain is not None:
        chain = build_chain(CHAIN_PROFILES[binding.quantity], binding.chain)
    return SourceConfig(*common, settings["delta"].value, chain)


def _find_quantity(name: str, axes: Mapping[str, Settings], word: str) -> tuple[str, Quantity]:
    """Return axis and quantity of a name such as ``axis1.P_A``.

    Raises:
        ConfigError: there is no such axis, or no such quantity for a source or a sink.
    """
    possible = _SINKS if word == "sink" else _SOURCES
    axis, _, quantity = name.rpartition(".")
    if axis in axes and quantity in possible:
        return axis, Quantity(quantity)
    nearest = f"{find_nearest(axis, axes)}.{find_nearest(quantity, possible)}"
    wrong = f"can be no {word}" if axis in axes else "names no axis of the bench"
    raise ConfigError(f'{describe(name)} {wrong}; the nearest that can is "{nearest}"')


def _find_unit(symbol: str | None, quantity: Quantity) -> Unit:
    """Return the unit with a symbol; without one that of the SI.

    Raises:
        ConfigError: the quantity has no such unit.
    """
    units = UNITS[quantity]
    for unit in units:
        if symbol in {None, unit.symbol}:
            return unit
    known = ", ".join(f'"{unit.symbol}"' for unit in units)
    raise ConfigError(f"{describe(symbol)} is no unit of {quantity}; give one of {known}")


def _refusal(variable: Variable, binding: SourceConfig | SinkConfig) -> str | None:
    """Return what is wrong with the kind of an object, and what would be right."""
    access = variable.access
    if not isinstance(variable.data_type, IntegerType | RealType):
        right = "bind an object of an INTEGER, UNSIGNED or REAL type"
        return f"{variable.data_type.name}; {right}"
    if isinstance(binding, SinkConfig):
        if not access.writable:
            return f"{access.value}; a sink is an object that the bus may write"
    elif access is Access.CONST or not access.readable:
        return f"{access.value}; a source is an object that changes and that the bus may read"
    return None
