"""SDO download, expedited and segmented (CiA 301, 7.2.4.3.2 to 7.2.4.3.4)."""

import contextlib
from collections.abc import Iterator

from hil_bench.canopen_device.object_dictionary import Variable
from hil_bench.conformance.check import Chapter, Impact
from hil_bench.conformance.device import DeviceUnderTest, place
from hil_bench.conformance.sdo_client import (
    code_text,
    download_request,
    segmented_request,
    segments,
    shown,
)
from hil_bench.conformance.verdicts import Deviation, NotApplicable

CHAPTER = Chapter("SDO download")

_TOGGLE_ERROR, _SPECIFIER = 0x05030000, 0x05040001
_TOO_LONG = (0x06070010, 0x06070012)
_TOO_SHORT = (0x06070010, 0x06070013)

_HARMLESS = ((0x1017, 0), (0x1015, 0), (0x100C, 0), (0x1016, 1))
"""Times that may be changed for a moment without anything moving."""

_TRIAL = 1234
_TEXT = b"A text of more than one segment, and then some."


@CHAPTER.check("7.2.4.3.3", "an expedited download is confirmed and can be read back", Impact.WRITE)
def expedited(dut: DeviceUnderTest) -> str:
    """Write a harmless number."""
    with scratch(dut) as variable:
        request = download_request(variable.index, variable.subindex, _raw(variable, _TRIAL))
        answer = dut.sdo.exchange(request)
        right = b"\x60" + request[1:4]
        if answer[:4] != right:
            raise Deviation(
                f"{shown(request)}: answer {shown(answer)}; {shown(right)} ... is right"
            )
        _expect(dut, variable, _TRIAL)
        return place(variable.index, variable.subindex)


@CHAPTER.check(
    "7.2.4.3.3", "an expedited download without a size is taken, or aborted as such", Impact.WRITE
)
def without_size(dut: DeviceUnderTest) -> str:
    """Write with the size bit clear: stacks differ, and both are right."""
    with scratch(dut) as variable:
        request = download_request(variable.index, variable.subindex, _raw(variable, _TRIAL))
        answer = dut.sdo.exchange(b"\x22" + request[1:])
        if answer[0] == 0x60:
            _expect(dut, variable, _TRIAL)
            return "taken"
        code = dut.sdo.judge_abort(request, answer, (*_TOO_LONG, 0x06070013, _SPECIFIER))
        return f"abort {code_text(code)}"


@CHAPTER.check(
    "7.2.4.3.17",
    "too many bytes abort with 0607 0010h or 0012h, too few with 0010h or 0013h",
    Impact.WRITE,
)
def wrong_length(dut: DeviceUnderTest) -> None:
    """Write one byte more and one byte less than the object has, expedited."""
    with scratch(dut) as variable:
        key, size = (variable.index, variable.subindex), variable.data_type.size
        before = dut.sdo.upload(*key)
        if size < 4:
            dut.sdo.expect_abort(download_request(*key, bytes(size + 1)), *_TOO_LONG)
        if size > 1:
            dut.sdo.expect_abort(download_request(*key, bytes(size - 1)), *_TOO_SHORT)
        _expect(dut, variable, int.from_bytes(before, "little"))


@CHAPTER.check("7.2.4.3.4", "a segmented download works for a short object, too", Impact.WRITE)
def segmented_short(dut: DeviceUnderTest) -> None:
    """Write a number in one segment, with its size and without."""
    for with_size in (True, False):
        with scratch(dut) as variable:
            raw = _raw(variable, _TRIAL)
            dut.sdo.download_segments(
                *(variable.index, variable.subindex, raw),
                announced=len(raw) if with_size else None,
            )
            _expect(dut, variable, _TRIAL)


@CHAPTER.check("7.2.4.3.4", "a segmented download of a long object is read back", Impact.WRITE)
def segmented_long(dut: DeviceUnderTest) -> str:
    """Write a text of many segments to an object without a fixed length."""
    with long_scratch(dut) as variable:
        key = variable.index, variable.subindex
        dut.sdo.download(*key, _TEXT)
        if dut.sdo.upload(*key) != _TEXT:
            raise Deviation(f"{place(*key)}: other bytes are read than were written")
        return place(*key)


@CHAPTER.check("7.2.4.3.17", "a wrong toggle bit aborts with 0503 0000h", Impact.WRITE)
def toggle(dut: DeviceUnderTest) -> None:
    """Send the first segment with the toggle bit set; the object keeps its value."""
    with scratch(dut) as variable, unchanged(dut, variable):
        raw = _raw(variable, _TRIAL)
        _begin(dut, variable, len(raw))
        (segment,) = segments(raw)
        dut.sdo.expect_abort(bytes([segment[0] | 0x10]) + segment[1:], _TOGGLE_ERROR)


@CHAPTER.check(
    "7.2.4.3.17", "more bytes than announced abort with 0607 0010h or 0012h", Impact.WRITE
)
def more_than_announced(dut: DeviceUnderTest) -> None:
    """Announce the object's length and send a byte more; the object keeps its value."""
    with scratch(dut) as variable, unchanged(dut, variable):
        size = variable.data_type.size
        _begin(dut, variable, size)
        (segment,) = segments(bytes(size + 1))
        dut.sdo.expect_abort(segment, *_TOO_LONG)


@CHAPTER.check("7.2.4.3.17", "a length that is not the object's aborts", Impact.WRITE)
def announced_wrong(dut: DeviceUnderTest) -> str:
    """Announce another length than the object's: aborted at once, or with the segment."""
    with scratch(dut) as variable, unchanged(dut, variable):
        size = variable.data_type.size + 1
        request = segmented_request(variable.index, variable.subindex, size)
        answer = dut.sdo.exchange(request)
        if answer[0] == 0x60:
            (segment,) = segments(bytes(size))
            answer = dut.sdo.exchange(segment)
        return code_text(dut.sdo.judge_abort(request, answer, _TOO_LONG))


@CHAPTER.check("7.2.4.3.17", "a segment that nobody began aborts with 0504 0001h", Impact.WRITE)
def segment_without_transfer(dut: DeviceUnderTest) -> None:
    """Send a segment in the idle state."""
    dut.sdo.abort()
    (segment,) = segments(b"\0\0")
    dut.sdo.expect_abort(segment, _SPECIFIER)


@CHAPTER.check("7.2.4.3.17", "an aborted download changes nothing", Impact.WRITE)
def client_abort(dut: DeviceUnderTest) -> None:
    """Abort between the beginning and the last segment."""
    with scratch(dut) as variable, unchanged(dut, variable):
        raw = _raw(variable, _TRIAL)
        _begin(dut, variable, len(raw))
        dut.sdo.expect_silence(dut.sdo.abort_request())
        (segment,) = segments(raw)
        dut.sdo.expect_abort(segment, _SPECIFIER)


@CHAPTER.check(
    "7.5.2.33", "a further SDO channel of 1201h works beside the default one", Impact.WRITE
)
def further_channel(dut: DeviceUnderTest) -> None:
    """Open the channel with free identifiers, read by it, and close it again."""
    for subindex in (1, 2):
        dut.writable(0x1201, subindex)
    with dut.setting(0x1201, 1, 0x6D0), dut.setting(0x1201, 2, 0x6D1):
        channel = type(dut.sdo)(dut.wire, 0x6D0, 0x6D1, dut.patience)
        if channel.upload(0x1000) != dut.sdo.upload(0x1000):
            raise Deviation("another device type than by the default channel")


@contextlib.contextmanager
def restored(dut: DeviceUnderTest, variable: Variable) -> Iterator[None]:
    """Restore an object that is written meanwhile, whatever transfer is then under way."""
    key = variable.index, variable.subindex
    before = dut.sdo.upload(*key)
    try:
        yield
    finally:
        dut.sdo.abort()
        dut.sdo.download(*key, before)


@contextlib.contextmanager
def scratch(dut: DeviceUnderTest) -> Iterator[Variable]:
    """Restore a number that is written meanwhile.

    Yields:
        One whose change moves nothing.

    Raises:
        NotApplicable: there is none.
    """
    for key in _HARMLESS:
        variable = dut.objects.find(*key)
        if variable is not None and variable.access.writable:
            with restored(dut, variable):
                yield variable
            return
    raise NotApplicable("the EDS has no time of the communication profile that can be written")


@contextlib.contextmanager
def long_scratch(dut: DeviceUnderTest) -> Iterator[Variable]:
    """Restore an object without a fixed length that is written meanwhile.

    Yields:
        One.

    Raises:
        NotApplicable: there is none.
    """
    for variable in dut.objects:
        if (
            variable.data_type.size == 0
            and variable.access.writable
            and variable.access.readable
            and variable.index >= 0x2000
            and variable.data_type.name != "UNICODE_STRING"
        ):
            with restored(dut, variable):
                yield variable
            return
    raise NotApplicable("the EDS has no string or domain that can be written")


@contextlib.contextmanager
def unchanged(dut: DeviceUnderTest, variable: Variable) -> Iterator[None]:
    """Judge that an object still holds what it held."""
    before = dut.number(variable.index, variable.subindex)
    yield
    _expect(dut, variable, before)


def _begin(dut: DeviceUnderTest, variable: Variable, size: int) -> None:
    request = segmented_request(variable.index, variable.subindex, size)
    answer = dut.sdo.exchange(request)
    if answer[0] != 0x60:
        raise Deviation(f"{shown(request)}: answer {shown(answer)}; 60 ... is right")


def _raw(variable: Variable, value: int) -> bytes:
    return value.to_bytes(variable.data_type.size, "little")


def _expect(dut: DeviceUnderTest, variable: Variable, right: int) -> None:
    key = variable.index, variable.subindex
    found = dut.number(*key)
    if found != right:
        raise Deviation(f"{place(*key)} is {found}; {right} is right")
