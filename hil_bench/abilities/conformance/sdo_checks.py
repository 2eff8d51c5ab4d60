"""SDO upload and download, expedited and segmented (CiA 301, 7.2.4.3.2 to 7.2.4.3.7)."""

from hil_bench.abilities.conformance.check import Chapter, Degree, Impact
from hil_bench.abilities.conformance.device import DeviceUnderTest
from hil_bench.abilities.conformance.scratch import (
    expect_number,
    expect_text,
    long_scratch,
    scratch,
    unchanged,
    write_what_fits,
)
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable, Refused
from hil_bench.abilities.conformance.wire import (
    code_text,
    download_request,
    segmented_request,
    segments,
    shown,
    upload_request,
)
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.object_dictionary import Variable
from hil_bench.config.objects import name_object

UPLOAD = Chapter("SDO upload", Degree.REQUIRED, Impact.READ)
DOWNLOAD = Chapter("SDO download", Degree.REQUIRED)

_TOGGLE_ERROR, _TIMED_OUT, _SPECIFIER = 0x05030000, 0x05040000, 0x05040001
_TOO_LONG = (0x06070010, 0x06070012)
_TOO_SHORT = (0x06070010, 0x06070013)

_TRIAL = 1234
_TEXT = b"A text of more than one segment, and then some."

_BURST = 20

_LONGEST_TIME_OUT = 10.0
"""How long a device may wait for a client that has gone [s] until the check gives up."""


@UPLOAD.check("7.2.4.3.6", "an expedited answer states its length and names the object")
def expedited(dut: DeviceUnderTest) -> None:
    """Read 1000h and 1001h."""
    for index, command in ((0x1000, 0x43), (0x1001, 0x4F)):
        request = upload_request(index)
        dut.sdo.expect(request, bytes([command]) + request[1:4])


@UPLOAD.check("7.2.4.3.7", "a longer object comes in segments with alternating toggle bits")
def segmented(dut: DeviceUnderTest) -> str:
    """Read the longest object that there is; the length announced is that which comes."""
    index, subindex, size = long_object(dut)
    raw = dut.sdo.upload(index, subindex)
    if len(raw) != size:
        raise Deviation(f"{len(raw)} bytes came; {size} came before")
    return f"{name_object(index, subindex)}, {size} bytes"


@UPLOAD.check("7.2.4.3.17", "a toggle bit that does not alternate aborts with 0503 0000h")
def toggle(dut: DeviceUnderTest) -> None:
    """Ask for the first segment with the toggle bit set."""
    index, subindex, _ = long_object(dut)
    request = upload_request(index, subindex)
    dut.sdo.exchange(request)
    answer = dut.sdo.exchange(bytes([0x70, *bytes(7)]))
    dut.sdo.judge_abort(b"\x70", answer, (_TOGGLE_ERROR,))
    if answer[1:4] != request[1:4]:
        raise Deviation(f"the abort {shown(answer)} names another object than {shown(request)}")


@UPLOAD.check("7.2.4.3.17", "a segment that nobody began aborts with 0504 0001h")
def segment_without_transfer(dut: DeviceUnderTest) -> None:
    """Ask for a segment in the idle state."""
    dut.sdo.abort()
    dut.sdo.expect_abort(bytes([0x60, *bytes(7)]), _SPECIFIER)


@UPLOAD.check("7.2.4.3.17", "an unknown command specifier aborts with 0504 0001h")
def unknown_specifier(dut: DeviceUnderTest) -> None:
    """Send command specifier 7."""
    dut.sdo.expect_abort(bytes([0xE0, 0, 0x10, *bytes(5)]), _SPECIFIER)


@UPLOAD.check("7.2.4.3.17", "the first request after a reset aborts likewise", Impact.WRITE)
def fresh_server(dut: DeviceUnderTest) -> None:
    """Reset, then send an unknown command specifier, and a segment, as the first request."""
    for request in (bytes([0xE0, 0, 0x10, *bytes(5)]), bytes([0x60, *bytes(7)])):
        dut.boot()
        dut.sdo.expect_abort(request, _SPECIFIER)


@UPLOAD.check("7.2.4.3.17", "an abort from the client gets no answer, and ends the transfer")
def client_abort(dut: DeviceUnderTest) -> None:
    """Abort a segmented upload, and in the idle state."""
    index, subindex, _ = long_object(dut)
    request = upload_request(index, subindex)
    dut.sdo.exchange(request)
    dut.sdo.expect_silence(dut.sdo.abort_request())
    dut.sdo.expect_abort(bytes([0x60, *bytes(7)]), _SPECIFIER)
    dut.sdo.expect_silence(dut.sdo.abort_request())


@UPLOAD.check("7.2.4.3.17", "an upload that the client leaves times out with 0504 0000h")
def time_out(dut: DeviceUnderTest) -> str:
    """Begin an upload and say no more; how long a device waits is its own choice."""
    index, subindex, _ = long_object(dut)
    begin = dut.wire.now()
    request = upload_request(index, subindex)
    dut.sdo.exchange(request)
    answer = dut.sdo.answer(timeout=_LONGEST_TIME_OUT)
    if answer is None:
        dut.sdo.abort()
        raise NotApplicable(
            f"the device waits more than {_LONGEST_TIME_OUT:g} s; CiA 301 leaves it open"
        )
    dut.sdo.judge_abort(request, answer, (_TIMED_OUT,))
    return f"after {dut.wire.now() - begin:.1f} s"


@UPLOAD.check("7.2.4.3.1", "what is no SDO request gets no answer")
def no_request(dut: DeviceUnderTest) -> str:
    """Send requests of seven bytes and none, a remote frame and one with a 29-bit identifier.

    A short frame may as well be aborted, and one that has all that is needed be served.
    """
    request = upload_request(0x1000)
    detail = ""
    for frame, what, may_abort in (
        (Frame(dut.sdo.request_id, request, is_extended=True), "a 29-bit identifier", False),
        (Frame(dut.sdo.request_id, is_remote=True), "a remote frame", False),
        (Frame(dut.sdo.request_id, b""), "no byte", True),
        (Frame(dut.sdo.request_id, request[:7]), "seven bytes", True),
    ):
        dut.wire.send(frame)
        answer = dut.sdo.answer()
        if answer is None or (may_abort and answer[:1] == b"\x80"):
            continue
        if not (frame.data and may_abort and answer[:4] == b"\x43" + request[1:4]):
            raise Deviation(f"{what}: answer {shown(answer)}; silence is right")
        detail = f"a request of {what} is served"
    return detail


@UPLOAD.check("7.2.4.2", "a device answers requests to itself only")
def other_node(dut: DeviceUnderTest) -> None:
    """Send a request to a node-ID that nobody has."""
    request_id = 0x600 + dut.free_node_id
    dut.wire.forget()
    dut.wire.send(Frame(request_id, upload_request(0x1000)))
    answer = dut.sdo.answer()
    if answer is not None:
        raise Deviation(f"answer {shown(answer)} to a request by 0x{request_id:03X}")


@UPLOAD.check(
    "7.5.2.33", "1200h has the identifiers of the default channel", degree=Degree.OPTIONAL
)
def default_channel(dut: DeviceUnderTest) -> None:
    """Read 1200h, which is there only where the EDS has it."""
    dut.variable(0x1200, 1)
    found = dut.number(0x1200, 1), dut.number(0x1200, 2)
    right = dut.sdo.request_id, dut.sdo.answer_id
    if found != right:
        raise Deviation(f"{found[0]:03X}h and {found[1]:03X}h; {right[0]:03X}h, {right[1]:03X}h")


@UPLOAD.check("7.2.4.2", "a request is served while answers of other nodes pass")
def bystander(dut: DeviceUnderTest) -> None:
    """Read while an answer, a heartbeat and an emergency of a free node-ID are on the bus."""
    other = dut.free_node_id
    dut.wire.send(
        Frame(0x580 + other, upload_request(0x1000)),
        Frame(0x700 + other, b"\x05"),
        Frame(0x080 + other, bytes(8)),
    )
    dut.sdo.upload(0x1000)


@UPLOAD.check("7.2.4.2", "requests that do not wait for their answers leave the server alive")
def burst(dut: DeviceUnderTest) -> str:
    """Send twenty requests at once, then one that must be served."""
    for _ in range(_BURST):
        dut.sdo.send(upload_request(0x1000))
    answers = 0
    while answers <= _BURST and dut.sdo.answer() is not None:
        answers += 1
    if answers > _BURST:
        raise Deviation(f"more than {_BURST} answers to {_BURST} requests")
    dut.sdo.upload(0x1000)
    return f"{answers} of {_BURST} answered"


def long_object(dut: DeviceUnderTest) -> tuple[int, int, int]:
    """Return index, sub-index and length of the longest object above four bytes.

    Raises:
        NotApplicable: there is none.
    """
    best = (0, 0, 0)
    for variable in dut.objects:
        if variable.access.readable and not 1 <= variable.data_type.size <= 4:
            try:
                size = len(dut.sdo.upload(*variable.key))
            except Refused:
                continue
            best = max(best, (*variable.key, size), key=lambda found: found[2])
    if best[2] <= 4:
        raise NotApplicable("no object is longer than 4 bytes")
    return best


@DOWNLOAD.check("7.2.4.3.3", "an expedited download is confirmed and can be read back")
def download_expedited(dut: DeviceUnderTest) -> str:
    """Write a harmless number."""
    with scratch(dut) as variable:
        request = download_request(*variable.key, _raw(variable, _TRIAL))
        dut.sdo.expect(request, b"\x60" + request[1:4])
        expect_number(dut, variable, _TRIAL)
        return name_object(*variable.key)


@DOWNLOAD.check("7.2.4.3.3", "an expedited download without a size is taken, or aborted as such")
def without_size(dut: DeviceUnderTest) -> str:
    """Write with the size bit clear: stacks differ, and both are right."""
    with scratch(dut) as variable:
        request = download_request(*variable.key, _raw(variable, _TRIAL))
        answer = dut.sdo.exchange(b"\x22" + request[1:])
        if answer[0] == 0x60:
            expect_number(dut, variable, _TRIAL)
            return "taken"
        code = dut.sdo.judge_abort(request, answer, (*_TOO_LONG, 0x06070013, _SPECIFIER))
        return f"abort {code_text(code)}"


@DOWNLOAD.check(
    "7.2.4.3.17", "too many bytes abort with 0607 0010h or 0012h, too few with 0010h or 0013h"
)
def wrong_length(dut: DeviceUnderTest) -> None:
    """Write one byte more and one byte less than the object has, expedited."""
    with scratch(dut) as variable:
        key, size = variable.key, variable.data_type.size
        before = dut.sdo.upload(*key)
        if size < 4:
            dut.sdo.expect_abort(download_request(*key, bytes(size + 1)), *_TOO_LONG)
        if size > 1:
            dut.sdo.expect_abort(download_request(*key, bytes(size - 1)), *_TOO_SHORT)
        expect_number(dut, variable, int.from_bytes(before, "little"))


@DOWNLOAD.check("7.2.4.3.4", "a segmented download works for a short object, too")
def segmented_short(dut: DeviceUnderTest) -> None:
    """Write a number in one segment, with its size."""
    with scratch(dut) as variable:
        _write_segment(dut, variable, announced=variable.data_type.size)


@DOWNLOAD.check("7.2.4.3.4", "and so it does where the client does not give the size")
def segmented_without_size(dut: DeviceUnderTest) -> None:
    """Write a number in one segment, with the size bit of the initiation clear."""
    with scratch(dut) as variable:
        _write_segment(dut, variable, announced=None)


@DOWNLOAD.check("7.2.4.3.4", "a segmented download of a long object is read back")
def segmented_long(dut: DeviceUnderTest) -> str:
    """Write a text of many segments to an object without a fixed length, or what it takes."""
    with long_scratch(dut) as variable:
        key, write = variable.key, dut.sdo.download_segments
        raw = write_what_fits(
            dut, variable, _TEXT, lambda raw: write(*key, raw, announced=len(raw))
        )
        expect_text(dut, variable, raw)
        return f"{name_object(*variable.key)}, {len(raw)} bytes"


@DOWNLOAD.check(
    "7.2.4.3.17", "a segment with a wrong toggle bit aborts with 0503 0000h, or counts for nothing"
)
def download_toggle(dut: DeviceUnderTest) -> str:
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


@DOWNLOAD.check("7.2.4.3.17", "more bytes than announced abort with 0607 0010h or 0012h")
def more_than_announced(dut: DeviceUnderTest) -> None:
    """Announce the object's length and send a byte more; the object keeps its value."""
    with scratch(dut) as variable, unchanged(dut, variable):
        size = variable.data_type.size
        _begin(dut, variable, size)
        (segment,) = segments(bytes(size + 1))
        dut.sdo.expect_abort(segment, *_TOO_LONG)


@DOWNLOAD.check("7.2.4.3.17", "fewer bytes than announced abort with 0607 0010h or 0013h")
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
            raw = dut.sdo.upload(*variable.key)
            if not raw:
                return "a number; the text is empty"
            _begin(dut, variable, len(raw))
            _end_early(dut, variable, raw)
            return f"a number, and {name_object(*variable.key)}"
    except NotApplicable:
        return "a number"


@DOWNLOAD.check("7.2.4.3.17", "a length that is not the object's aborts")
def announced_wrong(dut: DeviceUnderTest) -> str:
    """Announce another length than the object's: aborted at once, or with the segment."""
    with scratch(dut) as variable, unchanged(dut, variable):
        size = variable.data_type.size + 1
        request = segmented_request(*variable.key, size)
        answer = dut.sdo.exchange(request)
        if answer[0] == 0x60:
            (segment,) = segments(bytes(size))
            answer = dut.sdo.exchange(segment)
        return code_text(dut.sdo.judge_abort(request, answer, _TOO_LONG))


@DOWNLOAD.check("7.2.4.3.17", "a segment that nobody began aborts with 0504 0001h")
def download_segment_without_transfer(dut: DeviceUnderTest) -> None:
    """Send a segment in the idle state."""
    dut.sdo.abort()
    (segment,) = segments(b"\0\0")
    dut.sdo.expect_abort(segment, _SPECIFIER)


@DOWNLOAD.check("7.2.4.3.17", "an aborted download changes nothing")
def download_client_abort(dut: DeviceUnderTest) -> None:
    """Abort between the beginning and the last segment."""
    with scratch(dut) as variable, unchanged(dut, variable):
        raw = _raw(variable, _TRIAL)
        _begin(dut, variable, len(raw))
        dut.sdo.expect_silence(dut.sdo.abort_request())
        (segment,) = segments(raw)
        dut.sdo.expect_abort(segment, _SPECIFIER)


@DOWNLOAD.check(
    "7.5.2.33",
    "a further SDO channel of 1201h works beside the default one",
    degree=Degree.OPTIONAL,
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
    dut.sdo.download_segments(*variable.key, raw, announced=announced)
    expect_number(dut, variable, _TRIAL)


def _end_early(dut: DeviceUnderTest, variable: Variable, raw: bytes) -> None:
    """Send the segments of a download but for its last byte; the last one must be aborted."""
    *before, last = segments(raw[:-1])
    for number, segment in enumerate(before):
        dut.sdo.send_segment(*variable.key, segment, number)
    dut.sdo.expect_abort(last, *_TOO_SHORT)


def _begin(dut: DeviceUnderTest, variable: Variable, size: int) -> None:
    dut.sdo.expect(segmented_request(*variable.key, size), b"\x60")


def _raw(variable: Variable, value: int) -> bytes:
    return value.to_bytes(variable.data_type.size, "little")
