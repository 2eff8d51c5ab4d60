"""EDS files (CiA 306): read, and checked for everything that the services rely on.

Parameter values of a DCF take the place of the EDS defaults.
"""

import math
import re
from collections.abc import Iterator, Mapping
from configparser import Error as ConfigParserError
from configparser import RawConfigParser
from functools import lru_cache
from pathlib import Path
from typing import Final

from hil_bench.canopen_device.datatypes import (
    DATA_TYPES,
    BooleanType,
    DataType,
    IntegerType,
    Value,
)
from hil_bench.canopen_device.eds_checks import find_faults
from hil_bench.canopen_device.eds_values import parse_integer, parse_value
from hil_bench.canopen_device.nmt import UNCONFIGURED
from hil_bench.canopen_device.object_dictionary import Access, ObjectDictionary, Variable
from hil_bench.errors import EdsError

_OBJECT_SECTION: Final = re.compile(
    r"(?P<index>[0-9A-F]{4})(?:SUB(?P<sub>[0-9A-F]+))?", re.IGNORECASE
)
_ARRAY: Final = 0x8
_COMPOSED: Final = frozenset({_ARRAY, 0x9})
_VAR: Final = 0x7
_OBJECT_TYPES: Final = frozenset({0x2, _VAR}) | _COMPOSED
_FIRST_OBJECT: Final = 0x1000
_HIGHEST_NODE_ID: Final = 127
_FILES_KEPT: Final = 8


def load_eds(path: Path, node_id: int) -> ObjectDictionary:
    """Return the object dictionary of the EDS or DCF at `path`, for the device `node_id`.

    For a device without node-ID (255) the defaults are those of node-ID 127, until
    `ObjectDictionary.assign_node_id` tells its own.

    Raises:
        EdsError: the file cannot serve as a device, or the node-ID is not 1 to 127 or 255; one
            line that names the file, the section, what is wrong and what would be right.
    """
    if node_id == UNCONFIGURED:
        node_id = _HIGHEST_NODE_ID
    if not 1 <= node_id <= _HIGHEST_NODE_ID:
        raise EdsError(
            f"{path}: node-ID {node_id} is not possible; write 1 to 127, or 255 for none"
        )
    return _EdsFile(path, node_id).build()


Sections = Mapping[str, Mapping[str, str]]
"""The options of an EDS as text, by section."""


class _EdsFile:
    """One EDS, as its text."""

    def __init__(self, path: Path, node_id: int) -> None:
        self._path = path
        self._node_id = node_id
        self._sections = self._parse(self._read_text())
        self._objects: dict[int, str] = {}
        self._entries: dict[int, dict[int, str]] = {}
        self._find_objects()

    def build(self) -> ObjectDictionary:
        """Return the object dictionary; EdsError where it cannot serve."""
        variables = (
            variable
            for index, section in self._objects.items()
            for variable in self._build_object(index, section)
        )
        object_dictionary = ObjectDictionary(variables, source=str(self._path))
        for fault in find_faults(object_dictionary):
            section = f"{fault.index:04X}"
            if fault.subindex and fault.index in object_dictionary:
                section += f"sub{fault.subindex:X}"
            raise self._error(section, fault.text)
        return object_dictionary

    def _read_text(self) -> str:
        try:
            raw = self._path.read_bytes()
        except OSError as error:
            reason = error.strerror or error
            raise EdsError(f"{self._path}: {reason}; name an EDS file that exists") from error
        try:
            return raw.decode("utf-8-sig")
        except UnicodeDecodeError:
            return raw.decode("latin-1")

    def _parse(self, text: str) -> Sections:
        try:
            sections = _parse(text, str(self._path))
        except ConfigParserError as error:
            raise EdsError(f"{self._path}: {_one_line(error)}; cannot be read as an EDS") from error
        if "DeviceInfo" not in sections:
            raise EdsError(f"{self._path}: [DeviceInfo] is missing; CiA 306 makes it mandatory")
        return sections

    def _error(self, section: str, text: str) -> EdsError:
        return EdsError(f"{self._path}: [{section}] {text}")

    def _option(self, section: str, option: str) -> str | None:
        """The text of an option; None where it is absent or empty."""
        return self._sections[section].get(option, "").strip() or None

    def _number(self, section: str, option: str, absent: int) -> int:
        text = self._option(section, option)
        if text is None:
            return absent
        try:
            return parse_integer(text, self._node_id)
        except ValueError as error:
            raise self._error(section, f"{option}: {error}") from None

    def _find_objects(self) -> None:
        """Find the sections of objects, and of their entries, and check them."""
        for section in self._sections:
            match = _OBJECT_SECTION.fullmatch(section)
            if match is None or (index := int(match["index"], 16)) < _FIRST_OBJECT:
                continue
            if match["sub"] is None:
                self._objects[index] = section
            else:
                self._entries.setdefault(index, {})[int(match["sub"], 16)] = section
        for index, section in self._objects.items():
            self._check_object(index, section)
        for index, entries in self._entries.items():
            for section in entries.values():
                self._check_entry(index, section)

    def _check_entry(self, index: int, section: str) -> None:
        if index not in self._objects:
            raise self._error(section, f"has no object; add [{index:04X}]")
        self._check_object(index, section, is_entry=True)

    def _check_object(self, index: int, section: str, *, is_entry: bool = False) -> None:
        if self._option(section, "ParameterName") is None:
            raise self._error(section, "has no ParameterName; CiA 306 makes it mandatory")
        object_type = self._number(section, "ObjectType", _VAR)
        if object_type not in _OBJECT_TYPES:
            allowed = "0x2 (DOMAIN), 0x7 (VAR), 0x8 (ARRAY) or 0x9 (RECORD)"
            raise self._error(section, f"ObjectType 0x{object_type:X} is unknown; write {allowed}")
        is_compact = self._option(section, "CompactSubObj") is not None
        if is_entry or is_compact or object_type not in _COMPOSED:
            self._data_type(section)
            self._access(section)
        elif 0 not in self._entries.get(index, {}):
            raise self._error(section, f"has no sub-index 0; add [{section}sub0]")

    def _data_type(self, section: str) -> DataType:
        code = self._number(section, "DataType", 0)
        if code not in DATA_TYPES:
            known = ", ".join(f"0x{known:04X}" for known in sorted(DATA_TYPES))
            raise self._error(section, f"DataType 0x{code:04X} is unknown; write one of {known}")
        return DATA_TYPES[code]

    def _access(self, section: str) -> Access:
        word = self._option(section, "AccessType")
        try:
            return Access((word or "").lower())
        except ValueError:
            known = ", ".join(access.value for access in Access)
            what = "is missing" if word is None else f"{word} is unknown"
            raise self._error(section, f"AccessType {what}; write one of {known}") from None

    def _build_object(self, index: int, section: str) -> Iterator[Variable]:
        object_type = self._number(section, "ObjectType", _VAR)
        count = self._number(section, "CompactSubObj", 0)
        if object_type not in _COMPOSED:
            yield self._build_variable(index, 0, section)
        elif count and object_type == _ARRAY:
            yield from self._build_compact(index, section, count)
        else:
            for subindex, entry in self._entries.get(index, {}).items():
                yield self._build_variable(index, subindex, entry)

    def _build_compact(self, index: int, section: str, count: int) -> Iterator[Variable]:
        """Yield the entries of a CompactSubObj array, each like the array's own section."""
        if not 1 <= count <= 254:
            raise self._error(section, f"CompactSubObj {count} is not possible; write 1 to 254")
        number_of_entries = DATA_TYPES[0x05]
        yield Variable(index, 0, "NrOfObjects", number_of_entries, access=Access.RO, default=count)
        names = self._section_of(f"{index:04X}NAME")
        values = self._section_of(f"{index:04X}VALUE")
        for subindex in range(1, count + 1):
            variable = self._build_variable(index, subindex, section)
            variable.name = (names and self._option(names, str(subindex))) or (
                f"{variable.name}_{subindex:x}"
            )
            text = self._option(values, str(subindex)) if values else None
            if values and text:
                variable.default = self._value(values, str(subindex), text, variable.data_type)
                variable.value = variable.default
                variable.base = self._base(text, variable)
            yield variable

    def _section_of(self, name: str) -> str | None:
        """The section of that name in whatever case, None where there is none."""
        return next((section for section in self._sections if section.upper() == name), None)

    def _build_variable(self, index: int, subindex: int, section: str) -> Variable:
        data_type = self._data_type(section)
        low = self._limit(section, "LowLimit", data_type)
        high = self._limit(section, "HighLimit", data_type)
        if low is not None and high is not None and low > high:
            raise self._error(section, f"LowLimit {low} is above HighLimit {high}")
        variable = Variable(
            index,
            subindex,
            self._sections[section]["ParameterName"],
            data_type,
            access=self._access(section),
            default=self._default(section, data_type, low, high),
            low=None if low == data_type.low else low,
            high=None if high == data_type.high else high,
            mappable=self._number(section, "PDOMapping", 0) != 0,
        )
        variable.base = self._base(self._default_text(section)[1] or "", variable)
        return variable

    def _base(self, text: str, variable: Variable) -> int | None:
        """The default without the node-ID, None where it does not follow the node-ID."""
        is_unsigned = isinstance(variable.data_type, IntegerType) and not variable.data_type.signed
        if not is_unsigned or "$NODEID" not in text.upper():
            return None
        return int(variable.default) - self._node_id

    def _value(self, section: str, option: str, text: str, data_type: DataType) -> Value:
        try:
            return parse_value(text, data_type, self._node_id)
        except ValueError as error:
            raise self._error(section, f"{option}: {error}") from None

    def _limit(self, section: str, option: str, data_type: DataType) -> float | None:
        text = self._option(section, option)
        if text is None or data_type.low is None or isinstance(data_type, BooleanType):
            return None
        value = self._value(section, option, text, data_type)
        if isinstance(value, int | float) and not math.isnan(value):
            return value
        raise self._error(section, f"{option} {text} is no limit; write a number")

    def _default_text(self, section: str) -> tuple[str, str | None]:
        """The option that gives an entry's default, and its text."""
        option = "ParameterValue" if self._option(section, "ParameterValue") else "DefaultValue"
        return option, self._option(section, option)

    def _default(
        self, section: str, data_type: DataType, low: float | None, high: float | None
    ) -> Value:
        option, text = self._default_text(section)
        if text is None:
            return _nearest(data_type.zero, low, high)
        value = self._value(section, option, text, data_type)
        if _nearest(value, low, high) != value:
            bounds = f"{'-' if low is None else low} to {'-' if high is None else high}"
            raise self._error(section, f"{option} {text} is outside its limits; write {bounds}")
        return value


@lru_cache(maxsize=_FILES_KEPT)
def _parse(text: str, source: str) -> Sections:
    """The sections of an EDS, kept for other devices of the same kind."""
    parser = RawConfigParser(inline_comment_prefixes=(";",))
    parser.optionxform = str  # type: ignore[assignment,method-assign]  # its documented use
    parser.read_string(text, source=source)
    return {section: dict(parser.items(section)) for section in parser.sections()}


def _nearest(value: Value, low: float | None, high: float | None) -> Value:
    """The value between the limits; a value that has no order stays as it is."""
    if isinstance(value, str | bytes):
        return value
    if low is not None and value < low:
        return low
    return high if high is not None and value > high else value


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
