"""Objects that stand for quantities of the plant, and those that a device profile asks for.

A `QuantitySource` shows a quantity in an object, a `SpoolSink` lets an object command a spool. In
both, value of the object = quantity × scale + offset. So an EDS file alone makes a device that a
controller can work with, such as a module with analogue inputs and outputs.

A sink obeys while a controller is there: from the first write of its object on, by RPDO or SDO, as
long as the node is OPERATIONAL. Leaving that state, and an RPDO that missed its deadline, end it:
the set-point is the safe one until the object is written anew. A value that only still stands in
the object commands nothing.
"""

import math
from typing import Final

from hil_bench.canopen_device.datatypes import DataType, IntegerType, Value
from hil_bench.canopen_device.events import NodeEventKind
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import ObjectDictionary, Variable
from hil_bench.errors import EdsError

# Finds the objects that a device profile asks for, and checks their data types.
#
# What the profile cannot do without is `required`; for the rest, `optional` gives a stand-in
# that no bus can reach, so that a device made from another maker's EDS file runs the same code.


TPDO_MAPPINGS: Final = range(0x1A00, 0x1C00)
"""Indices of the mapping parameters of TPDOs."""


def required(
    object_dictionary: ObjectDictionary, index: int, subindex: int, *data_types: DataType
) -> Variable:
    """Return the object at `index` and `subindex`.

    Raises:
        EdsError: there is none, or its data type is none of `data_types`.
    """
    variable = object_dictionary.find(index, subindex)
    if variable is None:
        raise EdsError(
            f"{object_dictionary.source}: object 0x{index:04X}.{subindex:02X} is missing; "
            f"the device profile needs it, as {_names(data_types)}"
        )
    if variable.data_type not in data_types:
        raise EdsError(
            f"{locate(object_dictionary, variable)} is {variable.data_type.name}; "
            f"the device profile needs {_names(data_types)}"
        )
    return variable


def optional(
    object_dictionary: ObjectDictionary,
    index: int,
    subindex: int,
    *data_types: DataType,
    absent: Value | None = None,
) -> Variable:
    """Return the object at `index` and `subindex`, or a stand-in with the value `absent`.

    EdsError, as of `required`, where the object is there and its data type is wrong.
    """
    if object_dictionary.find(index, subindex) is None:
        return Variable(index, subindex, "stand-in", data_types[0], default=absent)
    return required(object_dictionary, index, subindex, *data_types)


def locate(object_dictionary: ObjectDictionary, variable: Variable) -> str:
    """Return the place of a variable for messages: file, object and name."""
    place = f"object 0x{variable.index:04X}.{variable.subindex:02X} ({variable.name})"
    return f"{object_dictionary.source}: {place}"


def _names(data_types: tuple[DataType, ...]) -> str:
    return " or ".join(data_type.name for data_type in data_types)


class TpdoTrigger:
    """Sends the TPDOs that carry certain objects at present (types 0, 254, 255)."""

    def __init__(self, node: Node, *objects: tuple[int, int]) -> None:
        """Remember what to look for.

        Args:
            node: the node that sends them.
            objects: index and sub-index of each object.
        """
        self._node = node
        self._mappings = node.object_dictionary.indices(TPDO_MAPPINGS)
        self._mapped = frozenset(index << 8 | subindex for index, subindex in objects)

    def pull(self) -> None:
        """Tell the TPDOs that one of the objects has changed."""
        od = self._node.object_dictionary
        for index in self._mappings:
            entries = (od.number(index, sub) for sub in range(1, od.number(index) + 1))
            if any(entry >> 8 in self._mapped for entry in entries):
                self._node.trigger_tpdo(index - TPDO_MAPPINGS.start + 1)


# Saturation of integer objects: the nearest integer to a quantity that the object can hold.

_EXACT: Final = 2.0**51
_UNITS_ONLY: Final = 1.5 * 2.0**52  # from here to 2^53 doubles are the whole numbers


def nearest(value: float) -> int:
    """Round to the nearest integer, ties to even, as `round` does; compiled without a call."""
    if -_EXACT < value < _EXACT:
        return int(value + _UNITS_ONLY - _UNITS_ONLY)
    return round(value)


def saturate(value: float, lowest: int, highest: int, *, unknown: int) -> int:
    """Return `value` as the nearest integer from `lowest` to `highest`, or `unknown` for NaN."""
    if value <= lowest:
        return lowest
    if value >= highest:
        return highest
    return nearest(value) if value == value else unknown  # noqa: PLR0124 - false for NaN only


_FULL: Final = 1.0
_COMMANDS_LOST: Final = (NodeEventKind.RPDO_TIMEOUT, NodeEventKind.SRDO_FAILED)


class QuantitySource:
    """An object that shows a quantity, as far as its limits and its data type allow."""

    def __init__(
        self, node: Node, variable: Variable, scale: float, offset: float, delta: float | None
    ) -> None:
        """Bind the object.

        Args:
            node: the node that carries it on the bus.
            variable: the object, of an integer or a real type.
            scale: increments of the object for one unit of the quantity.
            offset: value of the object at a quantity of 0.
            delta: change that is an event for the TPDOs that carry the object [increments]; None
                where none is.
        """
        self._variable = variable
        self._scale, self._offset = scale, offset
        self._is_integer = isinstance(variable.data_type, IntegerType)
        low, high = variable.data_type.low or 0, variable.data_type.high or 0
        self._low = low if variable.low is None else variable.low
        self._high = high if variable.high is None else variable.high
        self._delta = math.inf if delta is None else delta
        self._trigger = TpdoTrigger(node, (variable.index, variable.subindex))
        self._told = math.nan

    def publish(self, quantity: float, now: int = 0) -> None:  # noqa: ARG002 - it has no delay
        """Put the present quantity into the object; an integer holds the nearest value."""
        value = self._shown(quantity * self._scale + self._offset)
        self._variable.value = value
        if abs(value - self._told) > self._delta:
            self._trigger.pull()
            self._told = value
        elif self._told != self._told:
            self._told = value

    def _shown(self, exact: float) -> int | float:
        if self._is_integer:
            return saturate(exact, int(self._low), int(self._high), unknown=self._variable.value)
        return min(max(exact, self._low), self._high)


class CommandWatch:
    """The watch on interruptions of the commands that a node receives.

    Attributes:
        interruptions: how many there were.
    """

    def __init__(self, node: Node) -> None:
        self.interruptions = 0
        self._node = node

    @property
    def is_operational(self) -> bool:
        """True if the node may be commanded now."""
        return self._node.state is NmtState.OPERATIONAL

    def hear(self) -> None:
        """Hear what happened to the node."""
        events = self._node.events
        while events:
            kind, detail = events.popleft()
            has_left = kind is NodeEventKind.STATE_CHANGED and detail != NmtState.OPERATIONAL
            if has_left or kind in _COMMANDS_LOST:
                self.interruptions += 1


class SpoolSink:
    """An object that commands the spool of an axis, in place of a valve of CiA 408.

    Attributes:
        full_opening: spool position of 100 % [m].
    """

    def __init__(
        self,
        watch: CommandWatch,
        variable: Variable,
        *,
        scale: float,
        offset: float,
        safe: float,
        full_opening: float,
    ) -> None:
        """Bind the object.

        Args:
            watch: that of the node which carries the object on the bus.
            variable: the object, of an integer or a real type.
            scale: increments of the object for 100 %.
            offset: value of the object at 0 %.
            safe: set-point while nobody commands it, as a part of the full opening.
            full_opening: spool position of 100 % [m].
        """
        self.full_opening = full_opening
        self._watch = watch
        self._variable = variable
        self._scale, self._offset = scale, offset
        self._safe = safe * full_opening
        self._obeys_since = -1  # interruptions at the last write
        variable.add_hook(self._take)

    def command(self, now: int) -> float:  # noqa: ARG002 - it acts at once
        """Return the spool set-point [m], at most the full opening to each side.

        Args:
            now: bench time [ns].
        """
        self._watch.hear()
        if self._obeys_since != self._watch.interruptions or not self._watch.is_operational:
            return self._safe
        share = (float(self._variable.value) - self._offset) / self._scale
        if math.isnan(share):
            return self._safe
        return min(max(share, -_FULL), _FULL) * self.full_opening

    def publish(self, spool_position: float, now: int) -> None:
        """Take the spool position, which such a device does not show by itself."""

    def _take(self, _written: float) -> None:
        self._watch.hear()  # what came before this write counts before it
        self._obeys_since = self._watch.interruptions
