"""SDO download, expedited and segmented (CiA 301, 7.2.4.3.2 to 7.2.4.3.4)."""

from hil_bench.abilities.conformance.check import Chapter, Degree, Impact
from hil_bench.abilities.conformance.device import DeviceUnderTest, place
from hil_bench.abilities.conformance.scratch import (
    expect_number,
    expect_text,
    long_scratch,
    scratch,
    unchanged,
    write_what_fits,
)
from hil_bench.abilities.conformance.sdo_client import (
    code_text,
    download_request,
    segmented_request,
    segments,
    shown,
)
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable
from hil_bench.canopen_device.object_dictionary import Variable

CHAPTER = Chapter("SDO download", Degree.REQUIRED)

_TOGGLE_ERROR, _SPECIFIER = 0x05030000, 0x05040001
_TOO_LONG = (0x06070010, 0x06070012)
_TOO_SHORT = (0x06070010, 0x06070013)

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
        expect_number(dut, variable, _TRIAL)
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
            expect_number(dut, variable, _TRIAL)
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
        expect_number(dut, variable, int.from_bytes(before, "little"))


@CHAPTER.check("7.2.4.3.4", "a segmented download works for a short object, too", Impact.WRITE)
def segmented_short(dut: DeviceUnderTest) -> None:
    """Write a number in one segment, with its size."""
    with scratch(dut) as variable:
        _write_segment(dut, variable, announced=variable.data_type.size)


@CHAPTER.check("7.2.4.3.4", "and so it does where the client does not give the size", Impact.WRITE)
def segmented_without_size(dut: DeviceUnderTest) -> None:
    """Write a number in one segment, with the size bit of the initiation clear."""
    with scratch(dut) as variable:
        _write_segment(dut, variable, announced=None)


@CHAPTER.check("7.2.4.3.4", "a segmented download of a long object is read back", Impact.WRITE)
def segmented_long(dut: DeviceUnderTest) -> str:
    """Write a text of many segments to an object without a fixed length, or what it takes."""
    with long_scratch(dut) as variable:
        key = variable.index, variable.subindex

        def write(raw: bytes) -> None:
            dut.sdo.download_segments(*key, raw, announced=len(raw))

        raw = write_what_fits(dut, variable, _TEXT, write)
        expect_text(dut, variable, raw)
        return f"{place(*key)}, {len(raw)} bytes"


@CHAPTER.check(
    "7.2.4.3.17",
    "a segment with a wrong toggle bit aborts with 0503 0000h, or counts for nothing",
    Impact.WRITE,
)
def toggle(dut: DeviceUnderTest) -> str:
    """Send the first segment with the toggle bit set; the object keeps its value."""
    with scratch(dut) as variable, unchanged(dut, variable):
        raw = _raw(variable, _TRIAL)
        _begin(dut, variable, len(raw))
        (segment,) = segments(raw)
        request = bytes([segment[0] | 0x10]) + segment[1:]
        dut.sdo.send(request)
        answer = dut.sdo.answer()
        if answer is not None:
            return code_text(dut.sdo.judge_abort(request, answer, (_TOGGLE_ERROR,)))
        dut.sdo.abort()
    return "it counts for nothing"


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


@CHAPTER.check(
    "7.2.4.3.17", "fewer bytes than announced abort with 0607 0010h or 0013h", Impact.WRITE
)
def fewer_than_announced(dut: DeviceUnderTest) -> str:
    """Announce what the object holds and send a byte less; a number, then a text if there is one.

    The length of a number is known without the announcement, that of a text is not.
    """
    with scratch(dut) as variable, unchanged(dut, variable):
        raw = _raw(variable, _TRIAL)
        _begin(dut, variable, len(raw))
        _end_early(dut, variable, raw)
    try:
        with long_scratch(dut) as variable:
            raw = dut.sdo.upload(variable.index, variable.subindex)
            if not raw:
                return "a number; the text is empty"
            _begin(dut, variable, len(raw))
            _end_early(dut, variable, raw)
            return f"a number, and {place(variable.index, variable.subindex)}"
    except NotApplicable:
        return "a number"


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
    "7.5.2.33",
    "a further SDO channel of 1201h works beside the default one",
    Impact.WRITE,
    Degree.OPTIONAL,
)
def further_channel(dut: DeviceUnderTest) -> None:
    """Open the channel with free identifiers, read by it, and close it again."""
    for subindex in (1, 2):
        dut.writable(0x1201, subindex)
    with dut.setting(0x1201, 1, 0x6D0), dut.setting(0x1201, 2, 0x6D1):
        channel = type(dut.sdo)(dut.wire, 0x6D0, 0x6D1, dut.patience)
        if channel.upload(0x1000) != dut.sdo.upload(0x1000):
            raise Deviation("another device type than by the default channel")


def _write_segment(dut: DeviceUnderTest, variable: Variable, announced: int | None) -> None:
    raw = _raw(variable, _TRIAL)
    dut.sdo.download_segments(variable.index, variable.subindex, raw, announced=announced)
    expect_number(dut, variable, _TRIAL)


def _end_early(dut: DeviceUnderTest, variable: Variable, raw: bytes) -> None:
    """Send the segments of a download but for its last byte; the last one must be aborted."""
    *before, last = segments(raw[:-1])
    for number, segment in enumerate(before):
        dut.sdo.send_segment(variable.index, variable.subindex, segment, number)
    dut.sdo.expect_abort(last, *_TOO_SHORT)


def _begin(dut: DeviceUnderTest, variable: Variable, size: int) -> None:
    request = segmented_request(variable.index, variable.subindex, size)
    answer = dut.sdo.exchange(request)
    if answer[0] != 0x60:
        raise Deviation(f"{shown(request)}: answer {shown(answer)}; 60 ... is right")


def _raw(variable: Variable, value: int) -> bytes:
    return value.to_bytes(variable.data_type.size, "little")
