"""One entry of the object dictionary from the keys of its section in an EDS (CiA 306).

What a section says wrongly, or does not say, costs no more than that key: the finding tells what
the entry has in its place.
"""

import math
from typing import Final, NamedTuple

from hil_bench.canopen_device.datatypes import (
    DATA_TYPES,
    DOMAIN,
    BooleanType,
    DataType,
    IntegerType,
    Value,
)
from hil_bench.canopen_device.eds_checks import required_type
from hil_bench.canopen_device.eds_document import (
    Document,
    EdsFinding,
    Section,
    Severity,
    parse_integer,
    parse_value,
    shown,
)
from hil_bench.canopen_device.frame import BIT_30, DISABLED, can_id
from hil_bench.canopen_device.object_dictionary import Access, Variable

# The pre-defined connection set (CiA 301): COB-IDs of a device whose EDS gives no others.


class Predefined(NamedTuple):
    """A COB-ID parameter's default.

    Attributes:
        cob_id: for node-ID 0.
        node_ids: 1 where the node-ID is added, else 0.
    """

    cob_id: int
    node_ids: int


_FIXED: Final = {
    (0x1005, 0): Predefined(0x080, 0),
    (0x1012, 0): Predefined(0x100, 0),
    (0x1014, 0): Predefined(0x080, 1),
    (0x1200, 1): Predefined(0x600, 1),
    (0x1200, 2): Predefined(0x580, 1),
}
_PDOS: Final = ((range(0x1400, 0x1600), 0x200), (range(0x1800, 0x1A00), 0x180))
_PREDEFINED_PDOS: Final = 4
_SDO_SERVERS: Final = range(0x1201, 0x1280)


def predefined_default(index: int, subindex: int) -> Predefined | None:
    """Return the default of a COB-ID parameter, None where the entry is none.

    PDOs after the fourth, and SDO servers after the first, are off.
    """
    for indices, first in _PDOS:
        if index in indices and subindex == 1:
            number = index - indices.start
            if number < _PREDEFINED_PDOS:
                return Predefined(first + 0x100 * number, 1)
            return Predefined(DISABLED, 0)
    if index in _SDO_SERVERS and subindex in {1, 2}:
        return Predefined(DISABLED, 0)
    return _FIXED.get((index, subindex))


_DOMAIN_OBJECT: Final = 0x2
_NOTHING: Final = ("0", "0x0")
"""What files give as the default of a domain or byte string that is empty."""

_SERVICES: Final = frozenset({0x1005, 0x1012, 0x1014})
"""Objects with the COB-ID of SYNC, TIME and EMCY."""

_FLAGS: Final = DISABLED | BIT_30

_ACCESS_WORDS: Final = ", ".join(access.value for access in Access)


class EntryReader:
    """Makes variables of sections, for the device `node_id`.

    Attributes:
        findings: what is wrong in them.
    """

    def __init__(self, document: Document, node_id: int, findings: list[EdsFinding]) -> None:
        self.findings = findings
        self._document = document
        self._node_id = node_id

    def build(self, index: int, subindex: int, section: Section) -> Variable:
        """Return the entry that a section describes."""
        data_type = self._data_type(index, subindex, section)
        access = self._access(section)
        low, high = self._limits(section, data_type, access)
        option, text = given_default(section)
        default = self._default(section, option, text, data_type, (low, high))
        variable = Variable(
            index,
            subindex,
            self._name(index, subindex, section),
            data_type,
            access=access,
            default=default,
            low=None if low == data_type.low else low,
            high=None if high == data_type.high else high,
            mappable=self._is_mappable(section),
        )
        variable.is_open = text is None
        variable.base = self._base(text or "", variable)
        self._check_identifier(section, option, variable)
        return variable

    def number(self, section: Section, key: str, absent: int) -> int:
        """Return the number of a key, `absent` where it is missing or none."""
        text = section.text(key)
        if text is None:
            return absent
        try:
            return parse_integer(text, self._node_id)
        except ValueError as error:
            self._note(section, key, f"{error}; it is passed over")
            return absent

    def set_default(self, section: Section, key: str, variable: Variable) -> None:
        """Give an entry the default that another section has for it under a key."""
        text = section.text(key)
        if text is None:
            return
        limits = variable.low, variable.high
        variable.default = self._default(section, key, text, variable.data_type, limits)
        variable.value = variable.default
        variable.is_open = False
        variable.base = self._base(text, variable)

    def _note(self, section: Section, key: str, text: str, *, works: bool = True) -> None:
        severity = Severity.WARNING if works else Severity.ERROR
        self.findings.append(section.finding(key, text, severity))

    def _name(self, index: int, subindex: int, section: Section) -> str:
        name = section.text("ParameterName")
        if name is None:
            name = f"0x{index:04X}.{subindex:02X}"
            self._note(section, "ParameterName", f"is missing; any text is right, {name} is taken")
        return name

    def _data_type(self, index: int, subindex: int, section: Section) -> DataType:
        required = required_type(index, subindex)
        found = self._declared_type(section)
        if required is not None and found is not required:
            what = "is missing" if found is None else f"is {found}"
            text = f"{what}; CiA 301 says {required}, which it is here"
            self._note(section, "DataType", text, works=found is None)
            return required
        if found is not None:
            return found
        code = section.text("DataType")
        wrong = "is missing" if code is None else f"{shown(code)} is no data type of CiA 301"
        follows = "the entry takes any bytes as a DOMAIN does, and cannot be mapped"
        self._note(section, "DataType", f"{wrong}; {follows}", works=False)
        return DOMAIN

    def _declared_type(self, section: Section) -> DataType | None:
        """The data type of a section, None where it is missing or unknown."""
        text = section.text("DataType")
        if text is None:
            is_domain = self.number(section, "ObjectType", 0) == _DOMAIN_OBJECT
            return DOMAIN if is_domain else None
        try:
            code = parse_integer(text)
        except ValueError:
            return None
        if code in DATA_TYPES:
            return DATA_TYPES[code]
        # CANFestival's editor names a section whose sub-index 1 holds the data type.
        alias = self._document.section(f"{code:X}sub1")
        alias_text = alias.text("DefaultValue") if alias else None
        try:
            return DATA_TYPES.get(parse_integer(alias_text or ""))
        except ValueError:
            return None

    def _access(self, section: Section) -> Access:
        word = section.text("AccessType")
        try:
            return Access((word or "").lower())
        except ValueError:
            is_domain = word is None and self.number(section, "ObjectType", 0) == _DOMAIN_OBJECT
            if not is_domain:
                wrong = "is missing" if word is None else f"is {shown(word)}"
                text = f"{wrong}; one of {_ACCESS_WORDS} is right, rw is taken"
                self._note(section, "AccessType", text)
            return Access.RW

    def _is_mappable(self, section: Section) -> bool:
        text = section.text("PDOMapping")
        if text in {None, "0"}:
            return False
        number = self.number(section, "PDOMapping", 0)
        if number not in {0, 1}:
            self._note(section, "PDOMapping", f"is {shown(text or '')}; 1 is right, and is taken")
        return number != 0

    def _limits(
        self, section: Section, data_type: DataType, access: Access
    ) -> tuple[float | None, float | None]:
        low = self._limit(section, "LowLimit", data_type)
        high = self._limit(section, "HighLimit", data_type)
        if low is None or high is None or low <= high:
            return low, high
        follows = "the bus may write any value" if access.writable else "neither counts"
        text = f"{low} is above HighLimit {high}; {follows}"
        self._note(section, "LowLimit", text, works=not access.writable)
        return None, None

    def _limit(self, section: Section, key: str, data_type: DataType) -> float | None:
        text = section.text(key)
        if text is None or data_type.low is None or isinstance(data_type, BooleanType):
            return None
        try:
            value = parse_value(text, data_type, self._node_id)
        except ValueError as error:
            self._note(section, key, f"{error}; it does not count")
            return None
        if isinstance(value, int | float) and not math.isnan(value):
            return value
        self._note(section, key, f"{shown(text)} is no limit; it does not count")
        return None

    def _default(
        self,
        section: Section,
        key: str,
        text: str | None,
        data_type: DataType,
        limits: tuple[float | None, float | None],
    ) -> Value:
        low, high = limits
        nearest = _nearest(data_type.zero, low, high)
        if text is None or (not data_type.size and text in _NOTHING):
            return nearest
        try:
            value = parse_value(text, data_type, self._node_id)
        except ValueError as error:
            return self._default_instead(section, key, data_type, (text, nearest, error))
        if _nearest(value, low, high) != value:
            bounds = f"{data_type.low if low is None else low} to "
            bounds += f"{data_type.high if high is None else high}"
            follows = "it is the value at power-on all the same"
            self._note(section, key, f"{shown(text)} is outside its limits, {bounds}; {follows}")
        return value

    def _default_instead(
        self,
        section: Section,
        key: str,
        data_type: DataType,
        given: tuple[str, Value, ValueError],
    ) -> Value:
        """Return the substitute for a default that cannot be used."""
        text, instead, error = given
        if isinstance(data_type.zero, str):
            plain = text.encode("ascii", "replace").decode("ascii")
            self._note(section, key, f"{error}; each is replaced by '?'")
            return plain
        if data_type.size:
            self._note(section, key, f"{error}; it is {instead!r} at power-on", works=False)
        else:
            self._note(section, key, f"{error}; it is empty at power-on")
        return instead

    def _base(self, text: str, variable: Variable) -> int | None:
        """The default without the node-ID, None where it does not follow the node-ID."""
        is_unsigned = isinstance(variable.data_type, IntegerType) and not variable.data_type.signed
        if not is_unsigned or "$NODEID" not in text.upper():
            return None
        return int(variable.default) - self._node_id

    def _check_identifier(self, section: Section, key: str, variable: Variable) -> None:
        """Give an identifier that has no default, or an impossible one, that of CiA 301."""
        predefined = predefined_default(variable.index, variable.subindex)
        if predefined is None:
            return
        given = section.text(key)
        if given is not None:
            is_possible = can_id(variable.default & ~_FLAGS) is not None
            if is_possible or variable.index not in _SERVICES:
                return
        variable.base = predefined.cob_id if predefined.node_ids else None
        variable.default = predefined.cob_id + predefined.node_ids * self._node_id
        variable.value = variable.default
        if given is not None:
            text = f"{shown(given)} is of another service; 0x{variable.default:X} is taken"
            self._note(section, key, text, works=False)


def given_default(section: Section) -> tuple[str, str | None]:
    """Return the key that gives an entry's default, and its text; that of a DCF comes first."""
    key = "ParameterValue" if section.text("ParameterValue") else "DefaultValue"
    return key, section.text(key)


def _nearest(value: Value, low: float | None, high: float | None) -> Value:
    """The value between the limits; a value that has no order stays as it is."""
    if isinstance(value, str | bytes):
        return value
    if low is not None and value < low:
        return low
    return high if high is not None and value > high else value
