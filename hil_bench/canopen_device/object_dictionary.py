"""The object dictionary: every value of a device, and the rules of access to it (CiA 301)."""

import math
from collections.abc import Callable, Iterable, Iterator
from enum import Enum
from typing import TYPE_CHECKING, Any

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.datatypes import DataType, Value
from hil_bench.canopen_device.errors import SdoAbort

if TYPE_CHECKING:
    from hil_bench.canopen_device.eds_document import EdsFinding

Check = Callable[[Any], None]
"""Told the decoded value before it is written; raises `SdoAbort` to refuse it."""
Admission = Callable[[], int]
"""Asked before a download of several frames begins; returns how many bytes it may bring at most,
and raises `SdoAbort` to refuse it."""
Hook = Callable[[Any], None]
"""Told the decoded value after it was written from the bus; raises `SdoAbort` where an action that
the write asks for has failed."""


class Access(Enum):
    """Access type of an object, by its EDS word (CiA 306): who may read, write and map it."""

    RO = "ro"
    WO = "wo"
    RW = "rw"
    RWR = "rwr"
    RWW = "rww"
    CONST = "const"

    @property
    def readable(self) -> bool:
        """True if an SDO client may read the object."""
        return self is not Access.WO

    @property
    def writable(self) -> bool:
        """True if an SDO client may write the object."""
        return self is not Access.RO and self is not Access.CONST

    @property
    def in_tpdo(self) -> bool:
        """True if a TPDO may carry the object: rwr is read by a PDO, rww only written by one."""
        return self is not Access.WO and self is not Access.RWW

    @property
    def in_rpdo(self) -> bool:
        """True if an RPDO may carry the object."""
        return self is Access.WO or self is Access.RW or self is Access.RWW


class Variable:
    """One entry of the object dictionary.

    Attributes:
        index: 16-bit index.
        subindex: 8-bit sub-index, 0 for an object without sub-indices.
        name: its name in the EDS.
        data_type: how its value looks on the bus.
        access: who may read, write and map it.
        default: value after power on and after a reset.
        low: lowest value that the bus may write, None for that of the data type.
        high: highest value that the bus may write, None for that of the data type.
        mappable: whether a PDO may carry it.
        is_carried: whether a default mapping of the EDS carries it, which then counts for more than
            `mappable` and `access`.
        base: default of the device with node-ID 0 (`$NODEID` in the EDS); None where the default
            does not follow the node-ID.
        value: the present value, of the data type's Python type; None where there is no data
            (an SDO upload then aborts with 0800 0024). The application assigns it directly and
            is answerable for its range.
        is_open: no file gives a default, so that what a real device holds is not known.
        is_plain: no limit, check or hook stands between the bus and the value.
    """

    __slots__ = (
        "_admission",
        "_checks",
        "_hooks",
        "access",
        "base",
        "data_type",
        "default",
        "high",
        "index",
        "is_carried",
        "is_open",
        "is_plain",
        "low",
        "mappable",
        "name",
        "subindex",
        "value",
    )

    def __init__(  # noqa: PLR0913 - one argument for each key of an EDS section
        self,
        index: int,
        subindex: int,
        name: str,
        data_type: DataType,
        *,
        access: Access = Access.RW,
        default: Value | None = None,
        low: float | None = None,
        high: float | None = None,
        mappable: bool = False,
        base: int | None = None,
    ) -> None:
        self.index = index
        self.subindex = subindex
        self.name = name
        self.data_type = data_type
        self.access = access
        self.default: Any = data_type.zero if default is None else default
        self.low = low
        self.high = high
        self.mappable = mappable
        self.is_carried = False
        self.is_open = False
        self.base = base
        self.value: Any = self.default
        self.is_plain = low is None and high is None
        self._admission: Admission | None = None
        self._checks: tuple[Check, ...] = ()
        self._hooks: tuple[Hook, ...] = ()

    @property
    def key(self) -> tuple[int, int]:
        """Its index and sub-index."""
        return self.index, self.subindex

    def __repr__(self) -> str:
        return f"<0x{self.index:04X}.{self.subindex:02X} {self.name} = {self.value!r}>"

    def copy(self) -> "Variable":
        """Return an entry of the same contents, without checks and hooks."""
        twin = Variable(
            self.index,
            self.subindex,
            self.name,
            self.data_type,
            access=self.access,
            default=self.default,
            low=self.low,
            high=self.high,
            mappable=self.mappable,
            base=self.base,
        )
        twin.default, twin.value = self.default, self.value
        twin.is_carried, twin.is_open = self.is_carried, self.is_open
        return twin

    def add_check(self, check: Check) -> None:
        """Ask `check` before each write from the bus."""
        self._checks += (check,)
        self.is_plain = False

    def add_hook(self, hook: Hook) -> None:
        """Tell `hook` after each write from the bus."""
        self._hooks += (hook,)
        self.is_plain = False

    def admit(self, admission: Admission) -> None:
        """Ask `admission` before a download of several frames begins."""
        self._admission = admission

    def most_bytes(self, otherwise: int) -> int:
        """Return the most bytes of a download: those of its type, or as `admit` says."""
        if self._admission is not None:
            return self._admission()
        return self.data_type.size or otherwise

    def write(self, value: Any) -> None:  # noqa: ANN401 - a value of any data type
        """Set the value as the bus does: limits and checks, the assignment, then the hooks.

        `SdoAbort` where a limit or check refuses the value; the old one stays.
        """
        if self.low is not None or self.high is not None:
            self.check_limits(value)
        for check in self._checks:
            check(value)
        self.value = value
        for hook in self._hooks:
            hook(value)

    def check_limits(self, value: Any) -> None:  # noqa: ANN401 - a value of any data type
        """Refuse a value that is not between the limits.

        Raises:
            SdoAbort: 0609 0031 too high, 0609 0032 too low, 0609 0030 not a number.
        """
        if self.low is None and self.high is None:
            return
        # A NaN is neither above nor below, and still not between limits.
        if math.isnan(value):
            raise SdoAbort(*abort_codes.VALUE)
        if self.high is not None and value > self.high:
            raise SdoAbort(*abort_codes.VALUE_TOO_HIGH)
        if self.low is not None and value < self.low:
            raise SdoAbort(*abort_codes.VALUE_TOO_LOW)


class ObjectDictionary:
    """All variables of one device, by index and sub-index.

    Attributes:
        source: the file it was read from, for messages; empty where there is none.
        findings: what is wrong in that file, and what the device has in its place.
        claims_lss: whether that file says that the device has LSS.
    """

    def __init__(self, variables: Iterable[Variable], source: str = "") -> None:
        self.source = source
        self.findings: tuple[EdsFinding, ...] = ()
        self.claims_lss = False
        self._objects: dict[int, dict[int, Variable]] = {}
        self._in_order: list[Variable] = []  # all of them, once somebody has asked
        for variable in variables:
            self.add(variable)

    def __iter__(self) -> Iterator[Variable]:
        if not self._in_order:
            self._in_order = [
                entries[subindex]
                for _, entries in sorted(self._objects.items())
                for subindex in sorted(entries)
            ]
        return iter(self._in_order)

    def copy(self, source: str) -> "ObjectDictionary":
        """Return the same for another device: entries of its own, without checks and hooks."""
        twin = ObjectDictionary((), source)
        twin._objects = {
            index: {subindex: each.copy() for subindex, each in entries.items()}
            for index, entries in self._objects.items()
        }
        twin.findings = self.findings
        twin.claims_lss = self.claims_lss
        return twin

    def add(self, variable: Variable) -> None:
        """Add an entry."""
        self._objects.setdefault(variable.index, {})[variable.subindex] = variable
        self._in_order = []

    def __contains__(self, index: int) -> bool:
        return index in self._objects

    def indices(self, among: range) -> list[int]:
        """Return the indices of `among` that exist, in ascending order."""
        return sorted(index for index in self._objects if index in among)

    def entries(self, index: int) -> list[Variable]:
        """Return the entries of an index by sub-index; none where the device has no such object."""
        entries = self._objects.get(index, {})
        return [entries[subindex] for subindex in sorted(entries)]

    def find(self, index: int, subindex: int = 0) -> Variable | None:
        """Return the variable, or None where the device has none there."""
        return self._objects.get(index, {}).get(subindex)

    def number(self, index: int, subindex: int = 0, *, absent: int = 0) -> int:
        """Return an integer object's value, or `absent` where the device has no such object."""
        variable = self.find(index, subindex)
        return absent if variable is None else int(variable.value)

    def variable(self, index: int, subindex: int = 0) -> Variable:
        """Return the variable.

        Raises:
            SdoAbort: 0602 0000 no such index, 0609 0011 no such sub-index (nor of a VAR).
        """
        try:
            subindices = self._objects[index]
        except KeyError:
            raise SdoAbort(*abort_codes.NO_OBJECT) from None
        try:
            return subindices[subindex]
        except KeyError:
            raise SdoAbort(*abort_codes.NO_SUBINDEX) from None

    def readable(self, index: int, subindex: int) -> Variable:
        """Return the variable that an SDO client may read.

        Raises:
            SdoAbort: it does not exist, 0601 0001 write only, 0800 0024 no data.
        """
        variable = self.variable(index, subindex)
        if not variable.access.readable:
            raise SdoAbort(*abort_codes.WRITE_ONLY)
        if variable.value is None:
            raise SdoAbort(*abort_codes.NO_DATA)
        return variable

    def writable(self, index: int, subindex: int) -> Variable:
        """Return the variable that an SDO client may write.

        Raises:
            SdoAbort: it does not exist, 0601 0002 read only.
        """
        variable = self.variable(index, subindex)
        if not variable.access.writable:
            raise SdoAbort(*abort_codes.READ_ONLY)
        return variable

    def upload(self, index: int, subindex: int) -> bytes:
        """Return the bytes that an SDO client reads; `SdoAbort` as `readable` says."""
        variable = self.readable(index, subindex)
        return variable.data_type.encode(variable.value)

    def download(self, index: int, subindex: int, raw: bytes) -> None:
        """Write what an SDO client sends: access, length, limits, checks, then hooks.

        `SdoAbort` as `writable`, `DataType.decode` and `Variable.write` say.
        """
        variable = self.writable(index, subindex)
        variable.write(variable.data_type.decode(raw))

    def add_check(self, index: int, subindex: int, check: Check) -> None:
        """Ask `check` before each write from the bus (SDO or RPDO); it raises to refuse."""
        self.variable(index, subindex).add_check(check)

    def add_hook(self, index: int, subindex: int, hook: Hook) -> None:
        """Tell `hook` after each write from the bus (SDO or RPDO), not after a restore."""
        self.variable(index, subindex).add_hook(hook)

    def assign_node_id(self, node_id: int) -> None:
        """Let the defaults that follow the node-ID be those of the device `node_id`."""
        for variable in self:
            if variable.base is not None:
                variable.default = variable.base + node_id & (1 << variable.data_type.bits) - 1

    def restore(self, indices: range) -> None:
        """Set the variables of `indices` back to their defaults."""
        for index in self.indices(indices):
            for variable in self._objects[index].values():
                variable.value = variable.default
