"""Finds the objects that a device profile asks for, and checks their data types.

What the profile cannot do without is `required`; for the rest, `optional` gives a stand-in that no
bus can reach, so that a device made from another maker's EDS file runs the same code.
"""

from typing import Final

from hil_bench.canopen_device.datatypes import DataType, Value
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import ObjectDictionary, Variable
from hil_bench.errors import EdsError

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
