"""Objects that follow a script, on a device of any kind."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from hil_bench.canopen_device.datatypes import IntegerType, RealType
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import Access, ObjectDictionary, Variable
from hil_bench.config.objects import find_object, name_object
from hil_bench.config.values import quote
from hil_bench.devices.bound_objects import QuantitySource
from hil_bench.devices.scripted_objects import Course, ScriptedCourse, ScriptedFollower
from hil_bench.errors import ConfigError


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
