"""Objects that are bound to quantities of a plant, on a device of any kind."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from hil_bench.canopen_device.datatypes import IntegerType, RealType
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import Access, ObjectDictionary, Variable
from hil_bench.config.objects import find_object, name_object
from hil_bench.config.values import quote
from hil_bench.devices.axis import Drive, Measurement
from hil_bench.devices.bound_objects import CommandWatch, QuantitySource, SpoolSink
from hil_bench.devices.kinds.surroundings import Surroundings
from hil_bench.devices.measurement.low_pass import ChainParameters
from hil_bench.devices.scripted_objects import Course, ScriptedCourse, ScriptedFollower
from hil_bench.errors import ConfigError


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
