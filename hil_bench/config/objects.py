"""The tables ``[nodes.NAME.objects]``: other defaults than those of the EDS file, and bindings."""

import re
import zlib
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from hil_bench.canopen_device.eds_checks import find_faults
from hil_bench.canopen_device.eds_document import parse_value
from hil_bench.canopen_device.object_dictionary import ObjectDictionary, Variable
from hil_bench.config.values import as_table, describe, quote
from hil_bench.errors import ConfigError, SdoAbort

ObjectValue = str | int | float
"""What may be given for an object; text may be a number of the EDS kind, as ``$NODEID+0x200``."""

ObjectTable = dict[str, ObjectValue | dict[str, object]]
"""By object: a value, or a table that binds it to the plant (`bindings`)."""

_HIGHEST_NODE_ID = 127
_OBJECT = re.compile(r"0[xX](?P<index>[1-9A-Fa-f][0-9A-Fa-f]{3})(?:\.(?P<sub>[0-9A-Fa-f]{1,2}))?")


def objects(value: object) -> ObjectTable:
    """Read a table of values of objects, each key in the form ``0x1400.05``.

    Raises:
        ConfigError: it is no such table.
    """
    table: ObjectTable = {}
    right = 'give objects and values, as in { "0x1400.05" = 100 }'
    for key, given in as_table(value, right).items():
        name = name_object(*parse_object(key))
        if name in table:
            raise ConfigError(f"{name} is given twice; give it once")
        if not isinstance(given, ObjectValue | dict):
            right = "give a number, text, a truth value or a binding"
            raise ConfigError(f"{name}: {describe(given)} is no value of an object; {right}")
        table[name] = given
    return table


def parse_object(name: object) -> tuple[int, int]:
    """Return index and sub-index of an object's name; without a sub-index it is 0.

    Raises:
        ConfigError: it is no name of an object.
    """
    match = _OBJECT.fullmatch(name) if isinstance(name, str) else None
    if match is None:
        right = 'write index and sub-index in hexadecimal, as in "0x1400.05" or "0x6042"'
        raise ConfigError(f"{describe(name)} is no object; {right}")
    return int(match["index"], 16), int(match["sub"] or "0", 16)


@lru_cache(maxsize=8192)
def name_object(index: int, subindex: int) -> str:
    """Return the name of an object, as in ``0x1400.05``."""
    return f"0x{index:04X}.{subindex:02X}"


def named_serial_number(name: str) -> int:
    """Return the serial number of the node of a name that has no other: its CRC-32.

    It is never 0, which stands for none.
    """
    return zlib.crc32(name.encode()) or 1


def override_defaults(
    object_dictionary: ObjectDictionary,
    values: Mapping[tuple[int, int], ObjectValue],
    *,
    place: str,
    node_id: int,
) -> None:
    """Set what objects have at power-on and after a reset.

    Args:
        object_dictionary: that of the device, which is not on a bus yet.
        values: by index and sub-index.
        place: how messages name the table that gives them.
        node_id: what ``$NODEID`` means; without a node-ID (255) as `load_eds` has it.

    Raises:
        ConfigError: an object is not there or cannot have its value.
    """
    for (index, subindex), given in values.items():
        try:
            variable = find_object(object_dictionary, index, subindex)
            _override(variable, given, min(node_id, _HIGHEST_NODE_ID))
        except ValueError as error:
            raise ConfigError(f"{place}.{name_object(index, subindex)}: {error}") from None
    for fault in find_faults(object_dictionary) if values else ():
        raise ConfigError(f"{place}.{name_object(fault.index, fault.subindex or 0)}: {fault.text}")


def find_object(object_dictionary: ObjectDictionary, index: int, subindex: int) -> Variable:
    """Return an object that somebody asks for.

    Raises:
        ValueError: the device has none there; the message names the nearest.
    """
    variable = object_dictionary.find(index, subindex)
    if variable is None:
        wanted = index << 8 | subindex
        nearest = min(
            object_dictionary, key=lambda other: abs((other.index << 8 | other.subindex) - wanted)
        )
        raise ValueError(
            f"is not in {object_dictionary.source}; the nearest is "
            f"{name_object(nearest.index, nearest.subindex)}, {quote(nearest.name)}"
        )
    return variable


def _override(variable: Variable, given: ObjectValue, node_id: int) -> None:
    text = str(int(given)) if isinstance(given, bool) else str(given)
    value: Any = parse_value(text, variable.data_type, node_id)
    try:
        variable.check_limits(value)
    except SdoAbort:
        right = f"give {_bound(variable.low)} to {_bound(variable.high)}"
        raise ValueError(f"{describe(given)} is out of range; {right}") from None
    variable.default = variable.value = value
    variable.is_open = False
    variable.base = value - node_id if "$NODEID" in text.upper() else None


def _bound(limit: float | None) -> str:
    return "any" if limit is None else f"{limit:.9g}"
