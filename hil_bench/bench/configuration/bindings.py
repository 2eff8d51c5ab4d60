"""Bindings in ``[nodes.NAME.objects]``: objects that show the plant, or command it.

``"0x6401.01" = { source = "axis1.P_A", unit = "bar", scale = 100 }`` writes a quantity to an
object, ``"0x6411.01" = { sink = "axis1.spool_setpoint", scale = 16384 }`` commands a spool by one.
In both, value of the object = quantity in `unit` × `scale` + `offset`.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from types import MappingProxyType
from typing import Final, NamedTuple

from hil_bench.bench.configuration.axes import Axes
from hil_bench.bench.configuration.loop import SINK_KEYS, SOURCE_KEYS
from hil_bench.config.objects import parse_object
from hil_bench.config.settings import Given, Key, Origin, Problems, Settings, give, read_table
from hil_bench.config.values import (
    boolean,
    describe,
    find_nearest,
    non_negative,
    nonzero,
    number,
    points,
    text,
)
from hil_bench.devices.kinds.bindings import (
    CHAIN_KEYS,
    CHAIN_TABLE,
    Follow,
    ScriptConfig,
    SinkConfig,
    SourceConfig,
    build_chain,
    check_chain,
    read_chain,
)
from hil_bench.devices.kinds.registry import GENERIC
from hil_bench.devices.measurement.low_pass import ChainParameters
from hil_bench.devices.scripted_objects import Course, Points, Sine
from hil_bench.errors import ConfigError
from hil_bench.plants.plant import AxisSettings, Quantity
from hil_bench.units import DEGREE, MILLISECOND, ONE, SECOND, UNITS_OF, Unit

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


# Scripts in ``[nodes.NAME.objects]``: objects that live without a plant.
#
# ``"0x6401.01" = { sine = 5000, offset = 10000, period_s = 2.0 }`` moves an object over time,
# ``"0x6401.02" = { follow = "0x6411.01" }`` by what the bus writes to another one.


FIRST_SCRIPTABLE: Final = 0x2000
_LONGEST = 1e6


def two_values(value: object) -> tuple[float, float]:
    """Return the first and the last value of a ramp.

    Raises:
        ConfigError: the value is something else.
    """
    if not isinstance(value, list) or len(value) != 2:
        raise ConfigError(f"{describe(value)} is no ramp; give [first, last]")
    read = number()
    return read(value[0]), read(value[1])


_DELTA = Key("delta", non_negative)
_OFFSET = Key("offset", number(), 0.0)
_REPEAT = Key("repeat", boolean, default=False)


def _time(name: str, example: str) -> Key:
    read = number(SECOND, low=1e-6, high=_LONGEST)
    return Key(name, read, None, SECOND, example=example)


SCRIPT_KEYS: Final[Mapping[str, tuple[Key, ...]]] = MappingProxyType(
    {
        "constant": (Key("constant", number(), example="1234"), _DELTA),
        "ramp": (
            Key("ramp", two_values, example="[0, 1000]"),
            _time("over_s", "5.0"),
            _REPEAT,
            _DELTA,
        ),
        "sine": (
            Key("sine", number(), example="1000"),
            _OFFSET,
            _time("period_s", "2.0"),
            Key("phase_deg", number(DEGREE), 0.0, DEGREE),
            _DELTA,
        ),
        "table": (Key("table", points(ONE), example="[[0, 0], [1, 1000]]"), _REPEAT, _DELTA),
        "follow": (
            Key("follow", text, example='"0x6411.01"'),
            Key("scale", nonzero, 1.0),
            _OFFSET,
            Key(
                "lag_ms",
                number(MILLISECOND, low=0.0, high=_LONGEST),
                0.0,
                MILLISECOND,
            ),
            _DELTA,
        ),
    }
)
"""The keys of each kind of script; the kind is one of them."""


def is_script(given: object) -> bool:
    """Return True if the value given for an object is a script."""
    return isinstance(given, dict) and bool(given.keys() & SCRIPT_KEYS.keys())


def read_scripts(
    nodes: Mapping[str, Settings], problems: Problems
) -> dict[str, tuple[ScriptConfig, ...]]:
    """Return the scripts of each node; one with a problem is noted and left out."""
    found: dict[str, tuple[ScriptConfig, ...]] = {}
    for node, settings in nodes.items():
        objects = (settings["objects"].value if "objects" in settings else None) or {}
        scripts = (
            _read_script(node, name, given, problems)
            for name, given in objects.items()
            if is_script(given)
        )
        found[node] = tuple(script for script in scripts if script is not None)
    return found


def _read_script(
    node: str, name: str, given: Mapping[str, object], problems: Problems
) -> ScriptConfig | None:
    table = f"nodes.{node}.objects.{name}"
    place = problems.place(table)
    words = sorted(given.keys() & {*SCRIPT_KEYS, "source", "sink"})
    if len(words) > 1:
        problems.add(place, f"is {' and '.join(words)} at once; give one of them")
        return None
    index, subindex = parse_object(name)
    if index < FIRST_SCRIPTABLE:
        problems.add(place, "belongs to the communication services; script one from 0x2000 up")
        return None
    keys = SCRIPT_KEYS[words[0]]
    settings = read_table(table, given, keys, problems)
    if len(settings) < len(keys):
        return None
    try:
        script = _build(words[0], settings)
    except ConfigError as error:
        problems.add(problems.place(table, words[0]), error)
        return None
    return ScriptConfig(index, subindex, script, settings["delta"].value, place)


def _build(word: str, settings: Settings) -> Course | Follow:
    """Return the script of checked keys; ConfigError where they do not go together."""
    if word != "follow":
        return build_course(word, settings)
    scale, offset = settings["scale"].value, settings["offset"].value
    value = settings[word].value
    return Follow(*parse_object(value), scale, offset, settings["lag_ms"].value * 1e-3)


def build_course(word: str, settings: Settings) -> Course:
    """Return the course over time of checked keys; ConfigError where they do not go together."""
    value = settings[word].value
    if word == "constant":
        return Points((0.0,), (value,))
    if word == "ramp":
        return Points((0.0, settings["over_s"].value), value, settings["repeat"].value)
    if word == "sine":
        phase = math.radians(settings["phase_deg"].value)
        return Sine(value, settings["offset"].value, settings["period_s"].value, phase)
    return _build_table(value, repeats=settings["repeat"].value)


def _build_table(value: tuple[tuple[float, float], ...], *, repeats: bool) -> Points:
    if not value:
        raise ConfigError("has no points; give [[time, value], ...]")
    times, values = zip(*value, strict=True)
    if times[0] < 0.0 or any(late <= early for early, late in pairwise(times)):
        raise ConfigError("its times do not rise from 0 or more; give rising times in seconds")
    return Points(times, values, repeats)
