"""One PDO of the device under test: its parameters as they are, and how to change them.

A PDO is disabled, changed and enabled again (CiA 301, 7.5.2.35 to 7.5.2.38).
"""

import contextlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial, wraps

from hil_bench.abilities.conformance.check import Judge
from hil_bench.abilities.conformance.device import DeviceUnderTest
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable
from hil_bench.abilities.conformance.wire import is_data
from hil_bench.canopen_device.frame import Frame

RPDOS, TPDOS = range(0x1400, 0x1600), range(0x1800, 0x1A00)
TO_MAPPING = 0x200
INVALID, NO_REMOTE = 1 << 31, 1 << 30
COB_ID, TYPE, INHIBIT_TIME, EVENT_TIMER = 1, 2, 3, 5

_CAN_ID = 0x7FF


@dataclass(frozen=True, slots=True)
class Entry:
    """One mapped object.

    Attributes:
        index: of the object.
        subindex: of the object.
        bits: its length.
    """

    index: int
    subindex: int
    bits: int

    @property
    def key(self) -> tuple[int, int]:
        """The object's index and sub-index."""
        return self.index, self.subindex

    @property
    def raw(self) -> int:
        """The same as a mapping has it."""
        return self.index << 16 | self.subindex << 8 | self.bits


class Pdo:
    """One PDO.

    Attributes:
        index: of its communication parameters.
        mapping: index of its mapping.
        cob_id: its COB-ID as it was found.
        can_id: its identifier.
        entries: what it carries.
    """

    def __init__(self, dut: DeviceUnderTest, index: int) -> None:
        self.index = index
        self.mapping = index + TO_MAPPING
        self._dut = dut
        self.cob_id = dut.number(index, COB_ID)
        self.can_id = self.cob_id & _CAN_ID
        count = dut.number(self.mapping)
        self.entries = [
            Entry(raw >> 16, raw >> 8 & 0xFF, raw & 0xFF)
            for raw in (dut.number(self.mapping, sub) for sub in range(1, min(count, 64) + 1))
        ]

    @property
    def length(self) -> int:
        """Bytes that it has."""
        return (sum(entry.bits for entry in self.entries) + 7) // 8

    def matches(self, frame: Frame) -> bool:
        """Return True if a frame is this PDO."""
        return is_data(frame, self.can_id)

    @contextlib.contextmanager
    def disabled(self) -> Iterator[None]:
        """Disable the PDO, and restore its COB-ID."""
        self._dut.write(self.index, COB_ID, self.cob_id | INVALID)
        try:
            yield
        finally:
            self._dut.write(self.index, COB_ID, self.cob_id | INVALID)
            self._dut.write(self.index, COB_ID, self.cob_id)

    @contextlib.contextmanager
    def configured(self, values: Mapping[int, int], *, clear: int = INVALID) -> Iterator[None]:
        """Give the communication parameters other values, enable the PDO; restore all.

        Args:
            values: by sub-index.
            clear: bits of the COB-ID to clear.
        """
        before = {subindex: self._dut.number(self.index, subindex) for subindex in values}
        with self.disabled():
            try:
                self._write(values)
                self._dut.write(self.index, COB_ID, self.cob_id & ~clear)
                yield
            finally:
                self._dut.write(self.index, COB_ID, self.cob_id | INVALID)
                self._write(before)

    def values(self) -> bytes:
        """Return the values of the mapped objects, as the PDO carries them.

        Raises:
            NotApplicable: an object cannot be read, or has no whole bytes.
        """
        data = b""
        for entry in self.entries:
            variable = self._dut.objects.find(*entry.key)
            if entry.bits % 8 or variable is None or not variable.access.readable:
                raise NotApplicable("what it carries cannot all be read")
            data += self._dut.sdo.upload(*entry.key)
        return data

    def _write(self, values: Mapping[int, int]) -> None:
        for subindex, value in values.items():
            self._dut.write(self.index, subindex, value)


_JudgePdo = Callable[[DeviceUnderTest, Pdo], str | None]


def first_pdo(dut: DeviceUnderTest, among: range, *subindices: int) -> Pdo:
    """Return the first PDO that carries something and has these parameters to be changed.

    Raises:
        NotApplicable: there is none.
    """
    pdo = find_pdo(dut, among, *subindices)
    if pdo is None:
        what = "RPDO" if among is RPDOS else "TPDO"
        needed = ", ".join(f"{sub:02X}" for sub in (COB_ID, *subindices))
        raise NotApplicable(f"no {what} with a mapping lets sub-indices {needed} be written")
    return pdo


def find_pdo(
    dut: DeviceUnderTest, among: range, *subindices: int, mapping: Iterable[int] = ()
) -> Pdo | None:
    """Return the first PDO that carries something and has these objects to be changed, else None.

    Args:
        dut: the device.
        among: indices of communication parameters.
        subindices: of its communication parameters, beside the COB-ID.
        mapping: sub-indices of its mapping.
    """
    return next(_pdos(dut, among, subindices, mapping), None)


def sound_pdos(dut: DeviceUnderTest, among: range, *subindices: int) -> list[Pdo]:
    """Return the PDO of `first_pdo`, and all others like it that are valid."""
    first = first_pdo(dut, among, *subindices)
    others = (pdo for pdo in _pdos(dut, among, subindices) if pdo.index != first.index)
    return [first, *(pdo for pdo in others if not pdo.cob_id & INVALID)]


def judge_each(judge: Callable[[Pdo], str | None], pdos: Iterable[Pdo]) -> str:
    """Judge each PDO by itself, and return their names with what was found.

    Raises:
        Deviation: of the first that deviates, with its name.
        NotApplicable: none could be judged.
    """
    found, reasons = [], {}
    for pdo in pdos:
        name = f"{pdo.index:04X}h"
        try:
            found.append(f"{name} {judge(pdo) or ''}".rstrip())
        except NotApplicable as reason:
            reasons[name] = str(reason)
        except Deviation as deviation:
            raise Deviation(f"{name}: {deviation}") from deviation
    if not found:
        raise NotApplicable("; ".join(dict.fromkeys(reasons.values())))
    return "; ".join([*found, *(f"{name}: {reason}" for name, reason in reasons.items())])


def every(among: range, *subindices: int) -> Callable[[_JudgePdo], Judge]:
    """Return a decorator that makes a check of all PDOs of one that judges one of them.

    Args:
        among: indices of communication parameters.
        subindices: those that the check changes, beside the COB-ID.
    """

    def of_all(judge: _JudgePdo) -> Judge:
        @wraps(judge)
        def judge_all(dut: DeviceUnderTest) -> str:
            return judge_each(partial(judge, dut), sound_pdos(dut, among, *subindices))

        return judge_all

    return of_all


def _pdos(
    dut: DeviceUnderTest, among: range, subindices: Iterable[int], mapping: Iterable[int] = ()
) -> Iterator[Pdo]:
    """Yield the PDOs that carry something and have these objects to be changed."""
    for index in dut.objects.indices(among):
        keys = [(index, sub) for sub in (COB_ID, *subindices)]
        keys += [(index + TO_MAPPING, sub) for sub in mapping]
        variables = [dut.objects.find(*key) for key in keys]
        if all(variable is not None and variable.access.writable for variable in variables):
            pdo = Pdo(dut, index)
            if pdo.entries:
                yield pdo


def expect_length(pdo: Pdo, data: bytes) -> None:
    """Judge the length of a PDO.

    Raises:
        Deviation: it is not that of the mapping.
    """
    if len(data) != pdo.length:
        raise Deviation(f"PDO {pdo.index:04X}h of {len(data)} bytes; {pdo.length} by its mapping")
