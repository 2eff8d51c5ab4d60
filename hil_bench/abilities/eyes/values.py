"""Values of objects in words, and their scale."""

from collections.abc import Mapping
from typing import Final, NamedTuple

from hil_bench import units
from hil_bench.abilities.eyes.manager_objects import (
    CONCISE_DCF,
    dcf_problem,
    dcf_text,
    manager_text,
)
from hil_bench.canopen_device.datatypes import UNSIGNED32, DataType, Value
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.pdo_parameters import MappingEntry
from hil_bench.devices.rotary_encoder_406 import SCALING_BIT
from hil_bench.devices.valve_state_machine import STATUS_BITS
from hil_bench.errors import printable

# Scales of an object's numbers: the units of CiA 404, 406 and 408.
#
# An EDS has no units. The profiles do: in objects of their own, whose present values count.


MEASURING, ENCODER, VALVE = 404, 406, 408
"""Profile numbers in the low word of 0x1000."""


class Scale(NamedTuple):
    """The scale from a raw value to a quantity: (raw - offset) * factor, in the unit.

    Attributes:
        factor: of the unit for an increment.
        unit: that people read.
        offset: raw value of a quantity of 0.
    """

    factor: float
    unit: units.Unit
    offset: float = 0.0


_CELSIUS: Final = units.Unit("°C", "_c")
_PSI: Final = units.Unit("psi", "_psi", 6894.757293168361)
_PASCAL: Final = 0x22
_BASES: Final = {0x4E: units.BAR, 0xAB: _PSI, 0x2D: _CELSIUS, _PASCAL: units.Unit("Pa", "_pa")}
_PREFIXES: Final = dict(
    zip((-9, -6, -3, -2, -1, 0, 1, 2, 3, 6, 9), (*"nµmcd", "", "da", *"hkMG"), strict=True)
)

_REAL_PROCESS: Final = {0x6124, 0x6130, 0x6133, 0x6134, 0x6135, 0x6138, 0x6140, 0x6148, 0x6149}
_INTEGER_FORMATS: Final = (0x1000, 0x2000, 0x3000)
_DIGITS: Final = range(10)

_POSITIONS: Final = {0x6004, 0x6020}
_SPEED: Final = 0x6030
_STEPS: Final = 0x6005
_LINEAR: Final = {0x8, 0x9, 0xA}
"""Encoder types in the high word of 0x1000: linear, linear and cyclic, several sensors."""
_PER_TURN: Final = 0x6001
_RESOLUTION: Final = 0x6501
_SPEED_PARAMETERS: Final = 0x6031

_SPOOL: Final = {0x6300, 0x6301, 0x6310, 0x6314, 0x6320, 0x6321, 0x6350}
_AXIS: Final = {0x6600, 0x6601, 0x6610, 0x6614, 0x6620, 0x6621, 0x6650}
_PRESSURE_MODE: Final = {0x6380, 0x6381, 0x6390, 0x6394}
_WITH_UNIT: Final = _SPOOL | _AXIS | _PRESSURE_MODE
"""Records of a value, its unit and its prefix, the power of ten."""
_VALUE, _UNIT, _PREFIX = 1, 2, 3
_NO_UNIT, _METRE = 0, 1

CONTROL_WORD, STATUS_WORD = 0x6040, 0x6041
_CONTROL_BITS: Final = "DHMR"

_UNIT_OBJECTS: Final = frozenset(
    {0x1000, 0x6000, 0x6001, 0x6005, 0x6031, 0x6131, 0x6132, 0x6311, 0x6391, 0x6501}
)


def decides_scale(index: int, subindex: int) -> bool:
    """Return True for an object whose value decides how others are read."""
    return index in _UNIT_OBJECTS or (index in _WITH_UNIT and subindex in {_UNIT, _PREFIX})


def number_in(objects: ObjectDictionary, index: int, subindex: int = 0, absent: int = 0) -> int:
    """Return the value of an integer object; `absent` where it is unknown or no integer."""
    variable = objects.find(index, subindex)
    return variable.value if variable is not None and isinstance(variable.value, int) else absent


def profile_of(objects: ObjectDictionary) -> int:
    """Return the number of the device profile, 0 for none."""
    return number_in(objects, 0x1000) & 0xFFFF


def scale_of(objects: ObjectDictionary, index: int, subindex: int) -> Scale | None:
    """Return the scale of an object's numbers; None where no profile defines it, or it is open.

    The number of entries, sub-index 0 of an array or a record, has none.
    """
    if subindex == 0 and objects.find(index, 1) is not None:
        return None
    profile = profile_of(objects)
    if profile == MEASURING:
        return _measured(objects, index, subindex)
    if profile == ENCODER:
        return _encoded(objects, index)
    if profile == VALVE:
        return _commanded(objects, index, subindex)
    return None


def _is_open(objects: ObjectDictionary, index: int, subindex: int = 0) -> bool:
    """Return True for an object whose value neither the EDS nor the bus has given yet."""
    variable = objects.find(index, subindex)
    return variable is not None and variable.is_open and variable.value == variable.default


def _measured(objects: ObjectDictionary, index: int, subindex: int) -> Scale | None:
    unit = _unit(number_in(objects, 0x6131, subindex))
    if index in _REAL_PROCESS:
        return Scale(1.0, unit) if unit else None
    if _is_open(objects, 0x6132, subindex):
        return None
    digits = number_in(objects, 0x6132, subindex)
    if any(index - shift in _REAL_PROCESS for shift in _INTEGER_FORMATS) and digits in _DIGITS:
        return Scale(10.0**-digits, unit or units.ONE)
    return None


def _unit(code: int) -> units.Unit | None:
    """Return the unit of CiA 303-2: the highest byte a power of ten, the next one the unit."""
    power = int.from_bytes((code >> 24 & 0xFF).to_bytes(1, "big"), "big", signed=True)
    base, prefix = _BASES.get(code >> 16 & 0xFF), _PREFIXES.get(power)
    if base is None or prefix is None or code & 0xFFFF:
        return None
    return units.Unit(prefix + base.symbol, "", base.factor * 10.0**power)


def _encoded(objects: ObjectDictionary, index: int) -> Scale | None:
    """Return the scale of an encoder: steps of 0.001 µm and of 0.01 mm/s, or parts of a turn."""
    if per_turn := _steps_per_turn(objects):
        if index in _POSITIONS:
            return Scale(1.0 / per_turn, units.REVOLUTION)
        if index == _SPEED and (multiplier := number_in(objects, _SPEED_PARAMETERS, 3)):
            divider = number_in(objects, _SPEED_PARAMETERS, 4)
            return Scale(60.0 * divider / multiplier / per_turn, units.REVOLUTION_PER_MINUTE)
        return None
    if index in _POSITIONS and (step := number_in(objects, _STEPS, 1)):
        return Scale(step * 1e-6, units.MILLIMETRE)
    if index == _SPEED and (step := number_in(objects, _STEPS, 2)):
        return Scale(step * 1e-2, units.MILLIMETRE_PER_SECOND)
    return None


def _steps_per_turn(objects: ObjectDictionary) -> int:
    """Return the steps that a rotary encoder has in one revolution; 0 for a linear one."""
    is_linear = number_in(objects, 0x1000) >> 16 in _LINEAR
    if is_linear or objects.find(_PER_TURN) is None or _is_open(objects, 0x6000):
        return 0
    is_scaled = number_in(objects, 0x6000) & SCALING_BIT
    return number_in(objects, _PER_TURN if is_scaled else _RESOLUTION)


def _commanded(objects: ObjectDictionary, index: int, subindex: int) -> Scale | None:
    """Return the scale of a valve's value: of the reference where it has no unit of its own."""
    if index not in _WITH_UNIT or subindex != _VALUE:
        return None
    unit, prefix = (number_in(objects, index, sub) for sub in (_UNIT, _PREFIX))
    if unit == _METRE:
        return Scale(10.0 ** (prefix + 3), units.MILLIMETRE)
    if unit != _NO_UNIT:
        physical = _unit((prefix & 0xFF) << 24 | unit << 16)
        return physical and Scale(1.0, physical)
    places = ((_SPOOL, 0x6311), (_PRESSURE_MODE, 0x6391))
    for indices, reference_object in places:
        if index in indices and (reference := number_in(objects, reference_object, 1)):
            return Scale(100.0 / reference, units.PERCENT)
    return None


def word_text(profile: int, index: int, value: int) -> str:
    """Return a control or status word of CiA 408 with what it says; any other as its digits."""
    digits = f"0x{value:04X}"
    if profile != VALVE:
        return digits
    if index == STATUS_WORD:
        states = [state for state, bits in STATUS_BITS.items() if bits == value & 0xF]
        return f"{digits} {' or '.join(states) or 'no state'}"
    bits = "".join(letter for place, letter in enumerate(_CONTROL_BITS) if value >> place & 1)
    return f"{digits} {bits}" if bits else digits


# The value of an object as people read it.


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
