"""Between the plant and objects of a device: bindings, and chains of a sensor."""

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

from hil_bench.canopen_device.datatypes import IntegerType, RealType
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import Access, ObjectDictionary, Variable
from hil_bench.config import settings
from hil_bench.config.objects import find_object, name_object
from hil_bench.config.settings import read_rows, with_words
from hil_bench.config.values import Value, choice, quote
from hil_bench.devices.axis import Drive, Measurement
from hil_bench.devices.bound_objects import CommandWatch, QuantitySource, SpoolSink
from hil_bench.devices.measurement.chain import MeasuringChain
from hil_bench.devices.measurement.low_pass import ChainParameters, OverRange, random_stream
from hil_bench.devices.scripted_objects import Course, ScriptedCourse, ScriptedFollower
from hil_bench.errors import ConfigError
from hil_bench.plants.plant import AxisConfig

# The tables ``[nodes.NAME.chain]``: what lies between the plant and a sensor's objects.


# The keys of `[nodes.NAME.chain]`, a sensor's measuring chain, and the presets for them.
#
# `chain.tsv` declares each key, by the SI unit of what the chain carries where it depends on
# that. The sources of the presets are in `docs/measuring-chain.md`.


class PressurePreset(StrEnum):
    """Classes of pressure transducers."""

    IDEAL = "ideal"
    CLASS_025_250_BAR = "class_0.25_250_bar"


class AnglePreset(StrEnum):
    """Classes of rotary position sensors."""

    IDEAL = "ideal"


class PositionPreset(StrEnum):
    """Classes of position sensors."""

    IDEAL = "ideal"
    MAGNETOSTRICTIVE_1_UM = "magnetostrictive_1_um"


_PRESETS_OF: Final = {"Pa": PressurePreset, "m": PositionPreset, "rad": AnglePreset}
_GROUPS: Final = read_rows(Path(__file__).with_name("chain.tsv")).groups


def _keys(unit: str, presets: type[StrEnum]) -> tuple[settings.Key, ...]:
    keys = (*_GROUPS[unit], *_GROUPS["all"], *(() if unit == "Pa" else _GROUPS["speed"]))
    return tuple(with_words(keys, {"preset": choice(presets), "over_range": choice(OverRange)}))


CHAIN_KEYS: Final[Mapping[str, tuple[settings.Key, ...]]] = MappingProxyType(
    {unit: _keys(unit, presets) for unit, presets in _PRESETS_OF.items()}
)
"""By the SI unit of what the chain carries; what is in another unit has no chain."""

PRESETS: Final[Mapping[StrEnum, Mapping[str, Value]]] = MappingProxyType(
    {
        PressurePreset.IDEAL: {},
        PressurePreset.CLASS_025_250_BAR: {
            "offset_error_bar": 0.25,
            "offset_drift_bar_k": 0.02,
            "hysteresis_bar": 0.25,
            "noise_rms_bar": 0.04,
            "resolution_bar": 0.004,
            "range_bar": (-12.5, 275.0),
            "gain_error_percent": 0.1,
            "gain_drift_ppm_k": 80.0,
            "bandwidth_hz": 233.0,
            "sampling_period_us": 1000,
        },
        AnglePreset.IDEAL: {},
        PositionPreset.IDEAL: {},
        PositionPreset.MAGNETOSTRICTIVE_1_UM: {
            "hysteresis_um": 4.0,
            "noise_rms_um": 0.8,
            "resolution_um": 1.0,
            "gain_error_percent": 0.01,
            "gain_drift_ppm_k": 35.0,
            "sampling_period_us": 1000,
            "delay_us": 1000,
            "over_range": OverRange.INVALID,
            "speed_window_us": 10_000,
        },
    }
)
"""Defaults of the keys, by preset; a key that is not there has its own default."""


CHAIN_TABLE = "chain"
"""Name of the table of a measuring chain, within the table of its sensor."""

_MOST_WARMTH = 1000  # [K]


def read_chain(
    node: str, unit: str | None, given: settings.Given | None, problems: settings.Problems
) -> settings.Settings | None:
    """Return the settings of a chain; None where nothing has one, or where there is a problem.

    Args:
        node: the sensor's table, as in ``nodes.NAME``.
        unit: SI unit of what the chain carries; None where the device has no chain.
        given: what stands in its `chain`, if anything.
        problems: where problems are noted.
    """
    table = f"{node}.{CHAIN_TABLE}"
    if unit is None:
        return None
    keys = CHAIN_KEYS[unit]
    if given is None:
        return settings.read_table(table, {}, keys, problems)
    values = settings.open_table(table, given, problems)
    return _with_preset(settings.read_table(table, values, keys, problems))


def check_chains(chains: Mapping[str, settings.Settings], problems: settings.Problems) -> None:
    """Note values of the nodes' chains, given by node, that do not go together."""
    for name, chain in chains.items():
        check_chain(f"nodes.{name}.{CHAIN_TABLE}", chain, problems)


def check_chain(table: str, chain: settings.Settings, problems: settings.Problems) -> None:
    """Note values of the chain in `table` that do not go together."""
    period, phase = (chain[f"sampling_{name}_us"].value for name in ("period", "phase"))
    if phase and phase >= period:
        right = f"give 0 to {period - 1}" if period else "give sampling_period_us too"
        place = problems.place(table, "sampling_phase_us")
        problems.add(place, f"{phase} is not below sampling_period_us = {period}; {right}")
    (density,) = (setting for name, setting in chain.items() if name.startswith("noise_density"))
    if density.value and not chain["bandwidth_hz"].value:
        place = problems.place(table, density.key.name)
        problems.add(place, "has no bandwidth to fill; give bandwidth_hz too")
    _check_warming(table, chain["warming_s_k"].value, problems)


def build_chain(unit: str, chain: settings.Settings) -> ChainParameters:
    """Return the record of a checked chain."""
    keys = [key for key in CHAIN_KEYS[unit] if key.name != "preset"]
    return ChainParameters(**settings.convert(chain, keys))


def preset_chain(unit: str, preset: StrEnum) -> ChainParameters:
    """Return the measuring chain of a preset, for an SI unit, without further values."""
    problems = settings.Problems(f"preset {preset}")
    given = settings.Given(
        {"preset": preset.value}, settings.Origin.FILE, problems.place(CHAIN_TABLE)
    )
    chain = read_chain("nodes.sensor", unit, given, problems)
    problems.raise_any()
    return build_chain(unit, chain or {})


def _with_preset(chain: settings.Settings) -> settings.Settings:
    """Return the settings in which the preset's values take the place of the keys' defaults."""
    preset = PRESETS[chain["preset"].value] if "preset" in chain else {}
    return {
        name: setting._replace(value=preset[name])
        if setting.origin is settings.Origin.DEFAULT and name in preset
        else setting
        for name, setting in chain.items()
    }


def _check_warming(
    table: str, points: tuple[tuple[float, float], ...], problems: settings.Problems
) -> None:
    for (before, _), (after, _) in itertools.pairwise(points):
        if after < before:
            place = problems.place(table, "warming_s_k")
            problems.add(place, f"{after:g} s after {before:g} s; give times that do not decrease")
    for _, warmth in points:
        if abs(warmth) > _MOST_WARMTH:
            place = problems.place(table, "warming_s_k")
            problems.add(place, f"{warmth:g} K is out of range; give at most {_MOST_WARMTH} K")


# The surroundings of a device when it is built: the axes of the bench, its tick and its seed.


class Surroundings(NamedTuple):
    """The bench as a device sees it.

    Attributes:
        tick_ns: time between two ticks [ns].
        seed: of every random generator.
        axes: by name.
        full_scales: the command of 100 % of each axis [SI].
    """

    tick_ns: int
    seed: int
    axes: Mapping[str, AxisConfig]
    full_scales: Mapping[str, float]

    def chain(self, parameters: ChainParameters, name: str) -> MeasuringChain | None:
        """Return the measuring chain of the sensor of a name, None where it is ideal."""
        if parameters.is_ideal:
            return None
        return MeasuringChain(parameters, self.tick_ns, random_stream(self.seed, name))


@dataclass(frozen=True, slots=True)
class BindingConfig:
    """An object that is bound to a quantity of the plant.

    Attributes:
        index: of the object.
        subindex: of the object.
        axis: the axis whose quantity it is.
        quantity: what it shows or commands.
        scale: increments of the object for one SI unit; the spool counts in full openings.
        offset: value of the object at a quantity of 0.
        place: how messages name it.
    """

    index: int
    subindex: int
    axis: str
    quantity: str
    scale: float
    offset: float
    place: str = field(compare=False)

    @property
    def name(self) -> str:
        """The object, as in ``0x6401.01``."""
        return name_object(self.index, self.subindex)


@dataclass(frozen=True, slots=True)
class SourceConfig(BindingConfig):
    """An object that shows a quantity.

    Attributes:
        delta: change that is an event for its TPDOs [increments]; None where none is.
        chain: what lies between the quantity and the object.
    """

    delta: float | None
    chain: ChainParameters


@dataclass(frozen=True, slots=True)
class SinkConfig(BindingConfig):
    """An object that commands an axis.

    Attributes:
        safe: set-point while nobody commands it, as a part of the full scale.
        full_opening: command of 100 %, of a spool the position [m].
    """

    safe: float
    full_opening: float


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


def build_source(
    source: SourceConfig, name: str, node: Node, surroundings: Surroundings
) -> Measurement:
    """Build the measurement that writes a plant quantity to an object, by its chain if any."""
    axis = surroundings.axes[source.axis]
    quantity = axis.kind.by_name[source.quantity]
    full = surroundings.full_scales[source.axis] if quantity.is_share else 1.0
    shown = QuantitySource(
        node,
        find_bound(node.object_dictionary, source),
        scale=source.scale / full,
        offset=source.offset,
        delta=source.delta,
    )
    chain = surroundings.chain(source.chain, name)
    stages = () if chain is None else (chain.measure,)
    return Measurement(shown.publish, quantity, stages, name=name, full=full)


def build_sinks(name: str, sinks: tuple[SinkConfig, ...], node: Node) -> list[Drive]:
    """Build the drives that command axes from the objects of a node."""
    if not sinks:
        return []
    watch = CommandWatch(node)
    return [
        Drive(f"{name}.{sink.name}", sink.axis, _build_sink(sink, node, watch)) for sink in sinks
    ]


def _build_sink(config: SinkConfig, node: Node, watch: CommandWatch) -> SpoolSink:
    return SpoolSink(
        watch,
        find_bound(node.object_dictionary, config),
        scale=config.scale,
        offset=config.offset,
        safe=config.safe,
        full_opening=config.full_opening,
    )


def _refusal(variable: Variable, binding: SourceConfig | SinkConfig) -> str | None:
    """Return why an object cannot be bound, with a remedy; None where it can."""
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


# Objects that follow a script, on a device of any kind.


@dataclass(frozen=True, slots=True)
class Follow:
    """Another object of the node that an object follows.

    Attributes:
        index: of the other object.
        subindex: of the other object.
        scale: increments of the object for one of the other.
        offset: value of the object where the other is 0.
        lag: time constant [s]; 0 for none.
    """

    index: int
    subindex: int
    scale: float = 1.0
    offset: float = 0.0
    lag: float = 0.0


@dataclass(frozen=True, slots=True)
class ScriptConfig:
    """An object that follows a script.

    Attributes:
        index: of the object.
        subindex: of the object.
        script: what it shows.
        delta: change that is an event for its TPDOs [increments]; None where none is.
        place: how messages name it.
    """

    index: int
    subindex: int
    script: Course | Follow
    delta: float | None
    place: str = field(compare=False)

    @property
    def name(self) -> str:
        """The object, as in ``0x6401.01``."""
        return name_object(self.index, self.subindex)


def find_scripted(object_dictionary: ObjectDictionary, config: ScriptConfig) -> list[Variable]:
    """Return the object that a script moves, then the one that it follows, if any.

    Raises:
        ConfigError: one is not there, or is of a kind that holds no number or does not change.
    """
    variable = _find_number(object_dictionary, config.index, config.subindex, config.place)
    if variable.access is Access.CONST:
        right = "script an object that changes"
        raise ConfigError(f"{config.place}: {quote(variable.name)} is const; {right}")
    if not isinstance(config.script, Follow):
        return [variable]
    other = config.script.index, config.script.subindex
    return [variable, _find_number(object_dictionary, *other, f"{config.place}.follow")]


def build_script(config: ScriptConfig, node: Node) -> Callable[[int], None]:
    """Build the function that moves an object of a node in each tick."""
    variable, *followed = find_scripted(node.object_dictionary, config)
    show = partial(QuantitySource, node, variable, delta=config.delta)
    script = config.script
    if isinstance(script, Follow):
        shown = show(scale=script.scale, offset=script.offset)
        return ScriptedFollower(shown, followed[0], script.lag).advance
    return ScriptedCourse(show(scale=1.0, offset=0.0), script).advance


def _find_number(
    object_dictionary: ObjectDictionary, index: int, subindex: int, place: str
) -> Variable:
    try:
        variable = find_object(object_dictionary, index, subindex)
    except ValueError as error:
        raise ConfigError(f"{place}: {error}") from None
    if not isinstance(variable.data_type, IntegerType | RealType):
        right = "give an object of an INTEGER, UNSIGNED or REAL type"
        raise ConfigError(f"{place}: {quote(variable.name)} is {variable.data_type.name}; {right}")
    return variable
