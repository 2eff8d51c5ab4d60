"""The value of an object as people read it."""

from collections.abc import Mapping
from typing import NamedTuple

from hil_bench.abilities.eyes.manager_objects import (
    CONCISE_DCF,
    dcf_problem,
    dcf_text,
    manager_text,
)
from hil_bench.abilities.eyes.scaling import (
    CONTROL_WORD,
    STATUS_WORD,
    Scale,
    profile_of,
    scale_of,
    word_text,
)
from hil_bench.canopen_device.datatypes import UNSIGNED32, DataType, Value
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.pdo_mapping import MappingEntry
from hil_bench.errors import printable

_WORDS = frozenset({CONTROL_WORD, STATUS_WORD})
_COMMUNICATION = range(0x1000, 0x2000)
_MAPPINGS = (range(0x1600, 0x1800), range(0x1A00, 0x1C00))
_TIMES = frozenset({0x1002, 0x1006, 0x1007})
_LONGEST_TEXT = 60


class Reading(NamedTuple):
    """The value of an object.

    Attributes:
        object_index: of the object.
        subindex: of the object.
        name: in the EDS; empty where no EDS names it.
        value: in the unit; the raw bytes as hexadecimal digits where no data type is known.
        unit: its symbol; empty for none.
        text: the value with its unit, for people.
    """

    object_index: int
    subindex: int
    name: str
    value: float | str
    unit: str
    text: str

    @property
    def place(self) -> str:
        """The object, as in ``0x6130.01``."""
        return f"0x{self.object_index:04X}.{self.subindex:02X}"

    def __str__(self) -> str:
        return f"{self.name or self.place} {self.text}"


class Reader:
    """Turns the raw bytes of one object into readings.

    Args:
        objects: of the device.
        index: of the object.
        subindex: of the object.
        scales: what the numbers of bound objects stand for; they win over the profile.
    """

    def __init__(
        self,
        objects: ObjectDictionary,
        index: int,
        subindex: int,
        scales: Mapping[tuple[int, int], Scale],
    ) -> None:
        self.index = index
        self.subindex = subindex
        variable = objects.find(index, subindex)
        self.name = "" if variable is None else variable.name
        self.data_type: DataType | None = None if variable is None else variable.data_type
        self.scale = scales.get((index, subindex)) or scale_of(objects, index, subindex)
        self._profile = profile_of(objects)

    def read(self, raw: bytes) -> Reading:
        """Decode the raw bytes; show digits where they are no value of the data type."""
        return self.tell(self._decode(raw))

    def tell(self, value: Value) -> Reading:
        """Return a decoded value as a reading."""
        if isinstance(value, bytes):
            digits = f"[{value.hex(' ').upper()}]"
            text = dcf_text(value) if self._is_dcf() else digits
            return self._reading(value.hex().upper(), "", text)
        if isinstance(value, str):
            shown = printable(value.rstrip("\0"))
            cut = shown if len(shown) <= _LONGEST_TEXT else f"{shown[:_LONGEST_TEXT]}..."
            return self._reading(shown, "", f'"{cut}"')
        if self.index in _COMMUNICATION and (words := self._words(value)):
            return self._reading(value, "", words)
        if self.index in _WORDS:
            return self._reading(value, "", word_text(self._profile, self.index, int(value)))
        if self.scale is None:
            text = f"{value:.6g}" if isinstance(value, float) else str(int(value))
            return self._reading(value, "", text)
        factor, unit, offset = self.scale
        scaled = (value - offset) * factor
        symbol = "" if unit.symbol == "-" else unit.symbol
        return self._reading(scaled, symbol, f"{scaled:.6g} {symbol}".rstrip())

    def why_not(self, raw: bytes) -> str:
        """Return the mismatch of the raw bytes with the data type; empty where they agree."""
        if self.data_type is None or not isinstance(self._decode(raw), bytes):
            return ""
        size = self.data_type.size
        if self._is_dcf():
            return dcf_problem(raw)
        if not size:
            return "" if self._is_bytes() else f"is no {self.data_type.name}"
        if len(raw) == size:
            return ""
        return f"has {len(raw)} bytes, and is {self.data_type.name} of {size} in the EDS"

    def _words(self, value: float) -> str:
        """Return the value of an object of the communication profile; empty for a plain number."""
        if not isinstance(value, int):
            return ""
        words = manager_text(self.index, self.subindex, value)
        if not words and self.data_type is UNSIGNED32:
            return _communication_text(self.index, value)
        return words

    def _is_dcf(self) -> bool:
        return self.index == CONCISE_DCF and bool(self.subindex) and self._is_bytes()

    def _is_bytes(self) -> bool:
        return self.data_type is not None and isinstance(self.data_type.zero, bytes)

    def _decode(self, raw: bytes) -> Value:
        if self.data_type is None:
            return raw
        try:
            return self.data_type.decode(raw)
        except SdoAbort:
            return raw

    def _reading(self, value: float | str, unit: str, text: str) -> Reading:
        return Reading(self.index, self.subindex, self.name, value, unit, text)


def _communication_text(index: int, value: int) -> str:
    """Return an UNSIGNED32 of the communication profile as its tables have it: mostly hexadecimal.

    Args:
        index: of the object.
        value: what it holds.
    """
    if any(index in indices for indices in _MAPPINGS) and value:
        return str(MappingEntry.parse(value))
    return str(value) if index in _TIMES else f"0x{value:08X}"
