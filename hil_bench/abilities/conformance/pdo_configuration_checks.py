"""PDO parameters, the mapping procedure and what may be mapped (CiA 301, 7.5.2.35 to 7.5.2.38)."""

import contextlib
from collections.abc import Iterable, Iterator

from hil_bench.abilities.conformance.check import Chapter
from hil_bench.abilities.conformance.device import DeviceUnderTest
from hil_bench.abilities.conformance.pdo import (
    COB_ID,
    INHIBIT_TIME,
    INVALID,
    RPDOS,
    TPDOS,
    TYPE,
    Entry,
    Pdo,
    find_pdo,
    first_pdo,
)
from hil_bench.abilities.conformance.pdo_checks import SYNC
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable, Refused
from hil_bench.abilities.conformance.wire import code_text, download_request
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.object_dictionary import Variable
from hil_bench.config.objects import name_object

PARAMETERS = Chapter("PDO parameters")
MAPPING = Chapter("PDO mapping")

_RESTRICTED = (0x000, 0x001, 0x07F, 0x101, 0x180, 0x581, 0x601, 0x6E0, 0x701, 0x7FF)
"""Some of the restricted identifiers (7.3.5)."""

_NO_OBJECT, _NO_SUBINDEX = 0x06020000, 0x06090011
_NOT_MAPPABLE, _PDO_LENGTH = 0x06040041, 0x06040042

_DUMMY = 0x00050008
_LONGEST = 64


@PARAMETERS.check("7.5.2.35", "the identifier of a valid PDO cannot be changed")
def identifier_of_valid(dut: DeviceUnderTest) -> str:
    """Write another identifier while the PDO exists: any abort is right."""
    codes: set[int] = set()
    for pdo in (pdos := _each_kind(dut)):
        with pdo.configured({}):
            other = pdo.cob_id & ~INVALID ^ 0x400
            codes |= dut.expect_kept(pdo.index, COB_ID, [other])
    return _codes_text(codes, pdos)


@PARAMETERS.check("7.3.5", "restricted identifiers abort")
def restricted(dut: DeviceUnderTest) -> str:
    """Give a PDO the identifiers of NMT, SDO, error control and so on."""
    codes: set[int] = set()
    for pdo in (pdos := _each_kind(dut)):
        with pdo.disabled():
            for can_id in _RESTRICTED:
                cob_id = pdo.cob_id & ~INVALID & ~0x7FF | can_id
                codes |= dut.expect_kept(pdo.index, COB_ID, [cob_id])
    return _codes_text(codes, pdos)


@PARAMETERS.check("7.5.2.37", "the inhibit time of a valid TPDO cannot be changed")
def inhibit_time_of_valid(dut: DeviceUnderTest) -> str:
    """Write it while the PDO exists: any abort is right."""
    pdo = first_pdo(dut, TPDOS, INHIBIT_TIME)
    with pdo.configured({}):
        before = dut.number(pdo.index, INHIBIT_TIME)
        return _codes_text(dut.expect_kept(pdo.index, INHIBIT_TIME, [before + 1]), [pdo])


def _each_kind(dut: DeviceUnderTest) -> list[Pdo]:
    """Return the first RPDO and the first TPDO whose type can be changed.

    Raises:
        NotApplicable: there is neither.
    """
    pdos, why = [], ""
    for among in (RPDOS, TPDOS):
        try:
            pdos.append(first_pdo(dut, among, TYPE))
        except NotApplicable as reason:
            why = str(reason)
    if not pdos:
        raise NotApplicable(why)
    return pdos


def _codes_text(codes: set[int], pdos: Iterable[Pdo]) -> str:
    return f"{', '.join(map(code_text, sorted(codes)))} ({_names(pdos)})"


def _names(pdos: Iterable[Pdo]) -> str:
    return ", ".join(f"{pdo.index:04X}h" for pdo in pdos)


# The mapping procedure, and what may be mapped.


@MAPPING.check("7.5.2.36", "a mapping is written with the PDO disabled and sub-index 0 at 0")
def procedure(dut: DeviceUnderTest) -> str:
    """Write the present mapping anew."""
    names = []
    for pdo in _each_mappable(dut):
        with pdo.disabled():
            _restore_mapping(dut, pdo)
        if Pdo(dut, pdo.index).entries != pdo.entries:
            raise Deviation(f"{pdo.mapping:04X}h is not as it was written")
        names.append(f"{pdo.mapping:04X}h")
    return ", ".join(names)


@MAPPING.check("7.5.2.36", "an entry cannot be written while sub-index 0 is not 0")
def entry_of_complete(dut: DeviceUnderTest) -> str:
    """Write the first entry of a complete mapping: any abort is right."""
    codes: set[int] = set()
    for pdo in (pdos := _each_mappable(dut)):
        with pdo.disabled():
            codes |= dut.expect_kept(pdo.mapping, 1, [pdo.entries[0].raw ^ 0x100])
    return _codes_text(codes, pdos)


@MAPPING.check("7.5.2.36", "the mapping of a valid PDO cannot be changed")
def mapping_of_valid(dut: DeviceUnderTest) -> str:
    """Write 0 to sub-index 0 while the PDO exists: any abort is right."""
    codes: set[int] = set()
    for pdo in (pdos := _each_mappable(dut)):
        with pdo.configured({}):
            codes |= dut.expect_kept(pdo.mapping, 0, [0])
    return _codes_text(codes, pdos)


@MAPPING.check(
    "7.5.2.36", "mapping an object that is not there aborts with 0602 0000h or 0604 0041h"
)
def no_object(dut: DeviceUnderTest) -> str:
    """Map C0DEh, and a sub-index that is not there."""
    for pdo in (pdos := _each_mappable(dut)):
        with _opened(dut, pdo) as mapping:
            mapping.expect_abort(0xC0DE0008, _NO_OBJECT, _NOT_MAPPABLE)
            mapping.expect_abort(0x1018FE20, _NO_OBJECT, _NO_SUBINDEX, _NOT_MAPPABLE)
    return _names(pdos)


@MAPPING.check("7.2.4.3.17", "mapping what cannot be mapped aborts with 0604 0041h")
def not_mappable(dut: DeviceUnderTest) -> str:
    """Map an object that the EDS excludes."""
    variable = next(
        (
            v
            for v in dut.objects
            if not v.mappable and not v.is_carried and v.data_type.bits in {8, 16, 32}
        ),
        None,
    )
    if variable is None:
        raise NotApplicable("every object can be mapped")
    for pdo in (pdos := _each_mappable(dut)):
        with _opened(dut, pdo) as mapping:
            mapping.expect_abort(_entry(variable), _NOT_MAPPABLE)
    return _names(pdos)


@MAPPING.check("7.2.4.3.17", "mapping with a wrong length aborts")
def wrong_length(dut: DeviceUnderTest) -> str:
    """Map the first object with eight bits more than it has: any abort is right."""
    codes: set[int] = set()
    for pdo in (pdos := _each_mappable(dut)):
        with _opened(dut, pdo) as mapping:
            codes.add(mapping.expect_abort(pdo.entries[0].raw + 8))
    return _codes_text(codes, pdos)


@MAPPING.check("7.2.4.3.17", "more than 64 bits abort with 0604 0042h")
def too_many_bits(dut: DeviceUnderTest) -> str:
    """Map the longest object again and again."""
    tried = []
    for pdo in _each_mappable(dut):
        longest = _longest(dut, pdo)
        count = _LONGEST // longest.data_type.bits + 1
        if dut.objects.find(pdo.mapping, count) is None:
            continue
        with _opened(dut, pdo) as mapping:
            mapping.expect_too_long(_entry(longest), count)
        tried.append(f"{pdo.mapping:04X}h")
    if not tried:
        raise NotApplicable("no mapping has room for more than 64 bits")
    return ", ".join(tried)


@MAPPING.check("7.5.2.36", "sub-index 0 cannot exceed the number of entries")
def count_beyond(dut: DeviceUnderTest) -> str:
    """Write 65: any abort is right."""
    codes: set[int] = set()
    for pdo in (pdos := _each_mappable(dut)):
        with _opened(dut, pdo) as mapping:
            codes.add(mapping.expect_count_abort(65))
    return _codes_text(codes, pdos)


@MAPPING.check("7.5.2.36", "a dummy entry takes bits of an RPDO and nothing else")
def dummy(dut: DeviceUnderTest) -> str:
    """Map an UNSIGNED8 that is nowhere (0005h) before the first object, send the RPDO."""
    pdo, variable = _dummy_candidate(dut)
    key = variable.key
    before = dut.sdo.upload(*key)
    with _opened(dut, pdo):
        try:
            dut.write(pdo.mapping, 1, _DUMMY)
        except Refused as refused:
            raise NotApplicable(f"the device has no dummy entries: {refused}") from None
        dut.write(pdo.mapping, 2, pdo.entries[0].raw)
        dut.write(pdo.mapping, 0, 2)
        dut.write(pdo.index, COB_ID, pdo.cob_id & ~INVALID)
        right = bytes([before[0] ^ 1]) + before[1:]
        try:
            with dut.operational():
                dut.tell(Frame(pdo.can_id, b"\xff" + right), SYNC)
                found = dut.sdo.upload(*key)
                dut.sdo.download(*key, before)
        finally:
            dut.write(pdo.index, COB_ID, pdo.cob_id | INVALID)
    if found != right:
        raise Deviation(f"{name_object(*key)} holds {found.hex(' ')}; {right.hex(' ')} is right")
    return f"{pdo.mapping:04X}h"


def _dummy_candidate(dut: DeviceUnderTest) -> tuple[Pdo, Variable]:
    """Return an RPDO whose first object may stand behind eight bits of nothing.

    Raises:
        NotApplicable: there is none.
    """
    for pdo in _each_mappable(dut):
        variable = dut.objects.find(*pdo.entries[0].key)
        if (
            pdo.index in RPDOS
            and dut.objects.find(pdo.mapping, 2)
            and variable is not None
            and variable.access.readable
            and variable.data_type.bits in {8, 16, 32}
        ):
            return pdo, variable
    raise NotApplicable("no RPDO has a mapping that can be changed to a dummy and an object")


class _Mapping:
    """A mapping that may be written."""

    def __init__(self, dut: DeviceUnderTest, pdo: Pdo) -> None:
        self._dut = dut
        self._pdo = pdo

    def expect_abort(self, entry: int, *codes: int) -> int:
        """Write the first entry, and return the code by which it is refused."""
        return self._dut.sdo.expect_abort(self._request(1, entry), *codes)

    def expect_count_abort(self, count: int, *codes: int) -> int:
        """Write the number of entries, and return the code by which it is refused."""
        request = download_request(self._pdo.mapping, 0, bytes([count]))
        return self._dut.sdo.expect_abort(request, *codes)

    def expect_too_long(self, entry: int, count: int) -> None:
        """Write entries that are too long together: with the last of them, or their number."""
        for subindex in range(1, count + 1):
            request = self._request(subindex, entry)
            answer = self._dut.sdo.exchange(request)
            if answer[0] == 0x80:
                self._dut.sdo.judge_abort(request, answer, (_PDO_LENGTH,))
                return
        self.expect_count_abort(count, _PDO_LENGTH)

    def _request(self, subindex: int, entry: int) -> bytes:
        return download_request(self._pdo.mapping, subindex, entry.to_bytes(4, "little"))


@contextlib.contextmanager
def _opened(dut: DeviceUnderTest, pdo: Pdo) -> Iterator[_Mapping]:
    """Take a PDO's mapping out of use, and restore it.

    Yields:
        The mapping.
    """
    with pdo.disabled():
        dut.write(pdo.mapping, 0, 0)
        try:
            yield _Mapping(dut, pdo)
        finally:
            _restore_mapping(dut, pdo)


def _each_mappable(dut: DeviceUnderTest) -> list[Pdo]:
    """Return the first RPDO and the first TPDO whose mapping can be changed.

    Raises:
        NotApplicable: there is neither.
    """
    found = [find_pdo(dut, among, mapping=(0, 1)) for among in (RPDOS, TPDOS)]
    pdos = [pdo for pdo in found if pdo]
    if not pdos:
        raise NotApplicable("no PDO has a mapping that can be changed")
    return pdos


def _restore_mapping(dut: DeviceUnderTest, pdo: Pdo) -> None:
    dut.write(pdo.mapping, 0, 0)
    for number, entry in enumerate(pdo.entries, start=1):
        dut.write(pdo.mapping, number, entry.raw)
    dut.write(pdo.mapping, 0, len(pdo.entries))


def _entry(variable: Variable) -> int:
    return Entry(*variable.key, variable.data_type.bits).raw


def _longest(dut: DeviceUnderTest, pdo: Pdo) -> Variable:
    """Return the longest of the objects that the PDO carries already: these can be mapped."""
    variables = [dut.variable(*entry.key) for entry in pdo.entries]
    return max(variables, key=lambda variable: variable.data_type.bits)
