"""Bindings in ``[nodes.NAME.objects]``: objects that show the plant, or command it.

``"0x6401.01" = { source = "axis1.P_A", unit = "bar", scale = 100 }`` writes a quantity to an
object, ``"0x6411.01" = { sink = "axis1.spool_setpoint", scale = 16384 }`` commands a spool by one.
In both, value of the object = quantity in `unit` × `scale` + `offset`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from hil_bench.bench.configuration.axes import Axes
from hil_bench.bench.configuration.keys import SINK_KEYS, SOURCE_KEYS
from hil_bench.bench.configuration.scripts import SCRIPT_KEYS, is_script
from hil_bench.config.objects import parse_object
from hil_bench.config.settings import Given, Origin, Problems, Settings, give, read_table
from hil_bench.config.values import describe, find_nearest
from hil_bench.devices.measurement.parameters import ChainParameters
from hil_bench.errors import ConfigError
from hil_bench.kinds.bindings import SinkConfig, SourceConfig
from hil_bench.kinds.chains import CHAIN_KEYS, CHAIN_TABLE, build_chain, check_chain, read_chain
from hil_bench.kinds.registry import GENERIC
from hil_bench.plants.kind import AxisSettings
from hil_bench.plants.quantity import Quantity
from hil_bench.units import UNITS_OF, Unit

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
        """True if the object commands the plant."""
        return self.quantity.output is None


def read_bindings(nodes: Mapping[str, Settings], axes: Axes, problems: Problems) -> list[Binding]:
    """Return the bindings of all nodes; one with a problem is noted and left out."""
    found = []
    for node, settings in nodes.items():
        objects = settings["objects"].value if "objects" in settings else None
        for name, given in (objects or {}).items():
            if isinstance(given, dict) and not is_script(given):
                found.append(_read_binding(node, name, given, axes, problems))
    return [binding for binding in found if binding is not None]


def build_bindings(
    bindings: Sequence[Binding],
    nodes: Mapping[str, Settings],
    axes: Axes,
    problems: Problems,
) -> dict[str, list[SourceConfig | SinkConfig]]:
    """Return the records of the bindings by their node; a sink where none can be is noted."""
    built: dict[str, list[SourceConfig | SinkConfig]] = {name: [] for name in nodes}
    for binding in bindings:
        if binding.is_sink and nodes[binding.node]["profile"].value != GENERIC.name:
            wrong = f"nodes.{binding.node} does what its profile says"
            right = "give the sink to a node without a profile"
            problems.add(problems.place(binding.table, "sink"), f"{wrong}; {right}")
        if binding.chain is not None:
            check_chain(f"{binding.table}.{CHAIN_TABLE}", binding.chain, problems)
        place = problems.place(binding.table)
        built[binding.node].append(_build_binding(binding, axes[binding.axis], place))
    return built


def _read_binding(
    node: str,
    name: str,
    given: Mapping[str, object],
    axes: Axes,
    problems: Problems,
) -> Binding | None:
    table = f"nodes.{node}.objects.{name}"
    words = given.keys() & {"source", "sink"}
    if len(words) != 1:
        wrong = "is both a source and a sink" if words else "is bound to nothing"
        right = _HINT if words else f"{_HINT}, or a script: {', '.join(SCRIPT_KEYS)}"
        problems.add(problems.place(table), f"{wrong}; {right}")
        return None
    if parse_object(name)[0] < _FIRST_BINDABLE:
        wrong = "belongs to the communication services"
        problems.add(problems.place(table), f"{wrong}; bind an object from 0x2000 up")
    (word,) = words
    keys = SINK_KEYS if word == "sink" else SOURCE_KEYS
    if not axes:
        return None  # what is wrong with them is noted already
    values = give(table, given, Origin.FILE, problems)
    given_chain = values.pop(CHAIN_TABLE, None)
    settings = read_table(table, values, keys, problems)
    key = word
    try:
        axis, quantity = find_quantity(settings[key].value, axes, word)
        key = "unit"
        unit = find_unit(settings[key].value, quantity)
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
    if quantity.unit not in CHAIN_KEYS:
        problems.add(given.place, f"is for pressures and positions; {quantity.name} has none")
        return None
    return read_chain(table, quantity.unit, given, problems)


def _build_binding(binding: Binding, axis: AxisSettings, place: str) -> SourceConfig | SinkConfig:
    index, subindex = parse_object(binding.name)
    settings, unit = binding.settings, binding.unit
    common = (
        *(index, subindex, binding.axis, binding.quantity.name),
        *(settings["scale"].value / unit.factor, settings["offset"].value, place),
    )
    if binding.is_sink:
        full = axis.kind.command_unit.to_si(axis.kind.full_scale(axis.settings))
        sink = SinkConfig(*common, unit.to_si(settings["safe"].value), full)
        # The object counts in full scales, whatever unit its numbers are in.
        in_si = replace(sink, scale=sink.scale * full, safe=sink.safe / full)
        return sink if binding.quantity.is_share else in_si
    chain = ChainParameters()
    if binding.chain is not None:
        chain = build_chain(binding.quantity.unit, binding.chain)
    return SourceConfig(*common, settings["delta"].value, chain)


def find_quantity(name: str, axes: Axes, word: str) -> tuple[str, Quantity]:
    """Return axis and quantity of a name such as ``axis1.P_A``.

    Raises:
        ConfigError: there is no such axis, or no such quantity for a source or a sink.
    """
    axis, _, wanted = name.rpartition(".")
    near = axis if axis in axes else find_nearest(axis, axes)
    kind = axes[near].kind
    possible = [kind.command] if word == "sink" else kind.outputs
    for quantity in possible:
        if near == axis and quantity.name == wanted:
            return axis, quantity
    nearest = f"{near}.{find_nearest(wanted, (quantity.name for quantity in possible))}"
    wrong = f"can be no {word}" if axis in axes else "names no axis of the bench"
    raise ConfigError(f'{describe(name)} {wrong}; the nearest that can is "{nearest}"')


def find_unit(symbol: str | None, quantity: Quantity) -> Unit:
    """Return the unit with a symbol; without one that of the SI.

    Raises:
        ConfigError: the quantity has no such unit.
    """
    units = UNITS_OF.get(quantity.unit, (Unit(quantity.unit, ""),))
    for unit in units:
        if symbol in {None, unit.symbol}:
            return unit
    known = ", ".join(f'"{unit.symbol}"' for unit in units)
    raise ConfigError(f"{describe(symbol)} is no unit of {quantity.name}; give one of {known}")
