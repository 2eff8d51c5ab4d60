"""The object dictionary against the EDS (CiA 301, 7.4 and 7.5.2)."""

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

from hil_bench.abilities.conformance.check import Chapter, Degree, Impact
from hil_bench.abilities.conformance.device import DeviceUnderTest
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable, Refused
from hil_bench.abilities.conformance.wire import code_text, download_request, upload_request
from hil_bench.canopen_device.datatypes import IntegerType
from hil_bench.canopen_device.object_dictionary import Variable
from hil_bench.config.objects import name_object
from hil_bench.errors import SdoAbort

OBJECTS = Chapter("Object dictionary", Degree.REQUIRED, Impact.READ)

_RESERVED_INDEX = 0xC0DE
"""In C000h to FFFFh, where CiA 301 has no object."""

_NO_OBJECT, _NO_SUBINDEX = 0x06020000, 0x06090011
_WRITE_ONLY, _READ_ONLY = 0x06010001, 0x06010002

_NOT_NOW = frozenset({0x08000020, 0x08000021, 0x08000022, 0x08000024})
"""Aborts that say that an object is there and holds nothing at present."""

_MOST_SHOWN = 5

Case = TypeVar("Case")


@OBJECTS.check("7.5.2.1", "1000h has the device type of the EDS")
def device_type(dut: DeviceUnderTest) -> str | None:
    """Read 1000h."""
    return _expect_default(dut, 0x1000)


@OBJECTS.check("7.5.2.2", "1001h, the error register, is one byte")
def error_register(dut: DeviceUnderTest) -> str | None:
    """Read 1001h."""
    raw = dut.sdo.upload(0x1001)
    if len(raw) != 1:
        raise Deviation(f"{name_object(0x1001, 0)} has {len(raw)} bytes; 1 is right")
    return f"{raw[0]:02X}h"


@OBJECTS.check("7.5.2.21", "1018h has the identity of the EDS")
def identity(dut: DeviceUnderTest) -> str:
    """Read 1018h; 0 in an EDS stands for any device, and so does what it leaves open."""
    count = dut.number(0x1018)
    if not 1 <= count <= 4:
        raise Deviation(f"{name_object(0x1018, 0)} is {count}; 1 to 4 is right")
    given = [
        subindex
        for subindex in (1, 2, 3)
        if dut.objects.number(0x1018, subindex)
        and not _is_doubtful(dut, dut.variable(0x1018, subindex))
    ]
    if not given:
        raise NotApplicable("the EDS gives no identity")
    for subindex in given:
        _expect_default(dut, 0x1018, subindex)
    return f"sub-index {', '.join(map(str, given))}"


@OBJECTS.check("7.4.1", "every readable object of the EDS can be read and has its type's length")
def everything_readable(dut: DeviceUnderTest) -> str:
    """Read all of them."""
    readable = [variable for variable in dut.objects if variable.access.readable]
    return _judge_each(dut, readable, _read_fault)


@OBJECTS.check("7.4.1", "every constant of the EDS holds the value that the EDS gives")
def constants(dut: DeviceUnderTest) -> str:
    """Read all objects of access type const."""
    found = [variable for variable in dut.objects if variable.access.value == "const"]
    if not found:
        raise NotApplicable("the EDS has no constant")
    # A zero may as well be the EDS's way to say that devices differ.
    given = [
        variable
        for variable in found
        if not variable.is_open
        and variable.default not in {0, "", b""}
        and not _is_doubtful(dut, variable)
    ]
    if not given:
        raise NotApplicable("the EDS gives no constant a value")
    return _judge_each(dut, given, _constant_fault)


@OBJECTS.check("7.4.1", "sub-index 0 of an array or record is its highest sub-index")
def highest_subindex(dut: DeviceUnderTest) -> str:
    """Read sub-index 0 of what has more, but for counters that change."""
    counted = [
        variable.index
        for variable in dut.objects
        if variable.subindex == 0
        and dut.objects.find(variable.index, 1)
        and not variable.access.writable
    ]
    return _judge_each(dut, counted, _count_fault)


@OBJECTS.check("7.2.4.3.17", "reading a write-only object aborts with 0601 0001h")
def write_only(dut: DeviceUnderTest) -> str:
    """Read each write-only object of the EDS."""
    found = [variable for variable in dut.objects if not variable.access.readable]
    if not found:
        raise NotApplicable("the EDS has no write-only object")
    for variable in found:
        request = upload_request(*variable.key)
        dut.sdo.expect_abort(request, _WRITE_ONLY)
    return f"{len(found)} objects"


@OBJECTS.check("7.2.4.3.17", "reading an object that does not exist aborts with 0602 0000h")
def no_object(dut: DeviceUnderTest) -> None:
    """Read in the reserved range, and index 0."""
    for index in (_RESERVED_INDEX, 0x0000):
        dut.sdo.expect_abort(upload_request(index), _NO_OBJECT)


@OBJECTS.check("7.2.4.3.17", "reading a sub-index that does not exist aborts with 0609 0011h")
def no_subindex(dut: DeviceUnderTest) -> None:
    """Read a sub-index of a VAR, and one above the highest of a record."""
    dut.sdo.expect_abort(upload_request(0x1000, 1), _NO_SUBINDEX)
    dut.sdo.expect_abort(upload_request(0x1018, 0xFE), _NO_SUBINDEX)


@OBJECTS.check(
    "7.5.2.4", "beyond the number of errors, 1003h aborts with 0800 0024h", degree=Degree.OPTIONAL
)
def history_beyond(dut: DeviceUnderTest) -> str:
    """Read the history; by older editions of CiA 301 the code is 0609 0011h."""
    dut.variable(0x1003)
    count = dut.number(0x1003)
    for subindex in range(1, count + 1):
        dut.sdo.upload(0x1003, subindex)
    if dut.objects.find(0x1003, count + 1) is None:
        return f"{count} errors, the history is full"
    request = upload_request(0x1003, count + 1)
    return f"{count} errors, {code_text(dut.sdo.expect_abort(request, 0x08000024, 0x06090011))}"


@OBJECTS.check("7.2.4.3.17", "writing a read-only object aborts with 0601 0002h", Impact.WRITE)
def read_only(dut: DeviceUnderTest) -> str:
    """Write the present value to each read-only object of up to four bytes."""
    found = [
        variable
        for variable in dut.objects
        if not variable.access.writable and 1 <= variable.data_type.size <= 4
    ]
    return _judge_each(dut, found, _read_only_fault)


@OBJECTS.check("7.2.4.3.17", "writing what does not exist aborts likewise", Impact.WRITE)
def write_nothing(dut: DeviceUnderTest) -> None:
    """Write to an index and to a sub-index that are not there."""
    dut.sdo.expect_abort(download_request(_RESERVED_INDEX, 0, b"\0"), _NO_OBJECT)
    dut.sdo.expect_abort(download_request(0x1018, 0xFE, b"\0"), _NO_SUBINDEX)


@OBJECTS.check(
    "7.2.4.3.17", "a value beyond the EDS's limits aborts and changes nothing", Impact.WRITE
)
def limits(dut: DeviceUnderTest) -> str:
    """Write one more than the highest and one less than the lowest value: 0609 0030h to 0032h."""
    found = [(v, value) for v in dut.objects if v.access.writable for value in _beyond(v)]
    if not found:
        raise NotApplicable("the EDS limits no integer that can be written")
    return _judge_each(dut, found, _limit_fault, "values")


def _expect_default(dut: DeviceUnderTest, index: int, subindex: int = 0) -> str:
    variable = dut.variable(index, subindex)
    if variable.is_open:
        raise NotApplicable(f"the EDS gives {name_object(index, subindex)} no value")
    if _is_doubtful(dut, variable):
        raise NotApplicable(f"what the EDS says of {name_object(index, subindex)} is in doubt")
    right = int(variable.default)
    found = dut.number(index, subindex)
    if found != right:
        raise Deviation(f"{name_object(index, subindex)} is {found:08X}h; {right:08X}h by the EDS")
    return f"{found:08X}h"


def _is_doubtful(dut: DeviceUnderTest, variable: Variable) -> bool:
    """Return True if the EDS has a finding about an entry, whose default then may be ours."""
    sections = {f"{variable.index:04X}sub{variable.subindex:X}".lower()}
    if variable.subindex == 0:
        sections.add(f"{variable.index:04X}".lower())
    return any(finding.section.lower() in sections for finding in dut.objects.findings)


def _judge_each(
    dut: DeviceUnderTest,
    found: Sequence[Case],
    fault_of: Callable[[DeviceUnderTest, Case], str | None],
    what: str = "objects",
) -> str:
    """Judge each, and return their number.

    Raises:
        Deviation: something is wrong with some; it names a few of many.
    """
    faults = [fault for each in found if (fault := fault_of(dut, each))]
    if faults:
        more = f"; and {len(faults) - _MOST_SHOWN} more" if len(faults) > _MOST_SHOWN else ""
        raise Deviation("; ".join(faults[:_MOST_SHOWN]) + more)
    return f"{len(found)} {what}"


def _read_fault(dut: DeviceUnderTest, variable: Variable) -> str | None:
    name = name_object(*variable.key)
    try:
        raw = dut.sdo.upload(*variable.key)
    except Refused as refused:
        return None if refused.code in _NOT_NOW else str(refused)
    size = variable.data_type.size
    if size and len(raw) != size:
        return f"{name} has {len(raw)} bytes; {size} by the EDS ({variable.data_type})"
    return None


def _constant_fault(dut: DeviceUnderTest, variable: Variable) -> str | None:
    raw = dut.sdo.upload(*variable.key)
    try:
        found = variable.data_type.decode(raw)
    except SdoAbort:
        found = raw
    if found == variable.default:
        return None
    name = name_object(*variable.key)
    return f"{name} is {found!r}; {variable.default!r} by the EDS"


def _count_fault(dut: DeviceUnderTest, index: int) -> str | None:
    highest = max(v.subindex for v in dut.objects if v.index == index and v.subindex < 0xFF)
    found = dut.number(index)
    if found == highest:
        return None
    return f"{name_object(index, 0)} is {found}; {highest} is the highest sub-index in the EDS"


def _read_only_fault(dut: DeviceUnderTest, variable: Variable) -> str | None:
    try:
        raw = dut.sdo.upload(*variable.key)
    except Refused:
        raw = bytes(variable.data_type.size)
    request = download_request(*variable.key, raw[:4])
    try:
        dut.sdo.expect_abort(request, _READ_ONLY)
    except Deviation as deviation:
        return f"{name_object(*variable.key)}: {deviation}"
    return None


def _beyond(variable: Variable) -> Iterator[int]:
    """Yield the integers next to an object's limits that its data type can still carry."""
    data_type = variable.data_type
    if not isinstance(data_type, IntegerType) or data_type.size > 4:
        return
    if variable.low is not None and variable.low != data_type.low:
        yield int(variable.low) - 1
    if variable.high is not None and variable.high != data_type.high:
        yield int(variable.high) + 1


def _limit_fault(dut: DeviceUnderTest, case: tuple[Variable, int]) -> str | None:
    variable, value = case
    name = name_object(*variable.key)
    before = dut.sdo.upload(*variable.key) if variable.access.readable else None
    request = download_request(*variable.key, variable.data_type.encode(value))
    answer = dut.sdo.exchange(request)
    code = int.from_bytes(answer[4:], "little")
    is_too_high = variable.high is not None and value > variable.high
    right = {0x06090030, 0x06090031 if is_too_high else 0x06090032}
    after = dut.sdo.upload(*variable.key) if variable.access.readable else None
    if before is not None and after != before:
        dut.sdo.download(*variable.key, before)
        return f"{name} took {value}, which is beyond its limits"
    if answer[0] != 0x80:
        return f"{name} confirmed {value}, which is beyond its limits"
    if code not in right:
        return f"{name} := {value}: abort {code_text(code)}"
    return None
