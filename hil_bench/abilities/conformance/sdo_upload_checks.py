"""SDO upload, expedited and segmented (CiA 301, 7.2.4.3.5 to 7.2.4.3.7)."""

from hil_bench.abilities.conformance.check import Chapter, Degree, Impact
from hil_bench.abilities.conformance.device import DeviceUnderTest
from hil_bench.abilities.conformance.sdo_client import shown, upload_request
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable, Refused
from hil_bench.canopen_device.frame import Frame

CHAPTER = Chapter("SDO upload", Degree.REQUIRED)

_TOGGLE_ERROR, _TIMED_OUT, _SPECIFIER = 0x05030000, 0x05040000, 0x05040001

_BURST = 20

_LONGEST_TIME_OUT = 10.0
"""How long a device may wait for a client that has gone [s] until the check gives up."""


@CHAPTER.check("7.2.4.3.6", "an expedited answer states its length and names the object")
def expedited(dut: DeviceUnderTest) -> None:
    """Read 1000h and 1001h."""
    for index, command in ((0x1000, 0x43), (0x1001, 0x4F)):
        request = upload_request(index)
        answer = dut.sdo.exchange(request)
        right = bytes([command]) + request[1:4]
        if answer[:4] != right:
            raise Deviation(
                f"{shown(request)}: answer {shown(answer)}; {shown(right)} ... is right"
            )


@CHAPTER.check("7.2.4.3.7", "a longer object comes in segments with alternating toggle bits")
def segmented(dut: DeviceUnderTest) -> str:
    """Read the longest object that there is; the length announced is that which comes."""
    index, subindex, size = long_object(dut)
    raw = dut.sdo.upload(index, subindex)
    if len(raw) != size:
        raise Deviation(f"{len(raw)} bytes came; {size} came before")
    return f"0x{index:04X}.{subindex:02X}, {size} bytes"


@CHAPTER.check("7.2.4.3.17", "a toggle bit that does not alternate aborts with 0503 0000h")
def toggle(dut: DeviceUnderTest) -> None:
    """Ask for the first segment with the toggle bit set."""
    index, subindex, _ = long_object(dut)
    request = upload_request(index, subindex)
    dut.sdo.exchange(request)
    answer = dut.sdo.exchange(bytes([0x70, *bytes(7)]))
    dut.sdo.judge_abort(b"\x70", answer, (_TOGGLE_ERROR,))
    if answer[1:4] != request[1:4]:
        raise Deviation(f"the abort {shown(answer)} names another object than {shown(request)}")


@CHAPTER.check("7.2.4.3.17", "a segment that nobody began aborts with 0504 0001h")
def segment_without_transfer(dut: DeviceUnderTest) -> None:
    """Ask for a segment in the idle state."""
    dut.sdo.abort()
    dut.sdo.expect_abort(bytes([0x60, *bytes(7)]), _SPECIFIER)


@CHAPTER.check("7.2.4.3.17", "an unknown command specifier aborts with 0504 0001h")
def unknown_specifier(dut: DeviceUnderTest) -> None:
    """Send command specifier 7."""
    dut.sdo.expect_abort(bytes([0xE0, 0, 0x10, *bytes(5)]), _SPECIFIER)


@CHAPTER.check("7.2.4.3.17", "the first request after a reset aborts likewise", Impact.WRITE)
def fresh_server(dut: DeviceUnderTest) -> None:
    """Reset, then send an unknown command specifier, and a segment, as the first request."""
    for request in (bytes([0xE0, 0, 0x10, *bytes(5)]), bytes([0x60, *bytes(7)])):
        dut.boot()
        dut.sdo.expect_abort(request, _SPECIFIER)


@CHAPTER.check("7.2.4.3.17", "an abort from the client gets no answer, and ends the transfer")
def client_abort(dut: DeviceUnderTest) -> None:
    """Abort a segmented upload, and in the idle state."""
    index, subindex, _ = long_object(dut)
    request = upload_request(index, subindex)
    dut.sdo.exchange(request)
    dut.sdo.expect_silence(dut.sdo.abort_request())
    dut.sdo.expect_abort(bytes([0x60, *bytes(7)]), _SPECIFIER)
    dut.sdo.expect_silence(dut.sdo.abort_request())


@CHAPTER.check("7.2.4.3.17", "an upload that the client leaves times out with 0504 0000h")
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


@CHAPTER.check("7.2.4.3.1", "what is no SDO request gets no answer")
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


@CHAPTER.check("7.2.4.2", "a device answers requests to itself only")
def other_node(dut: DeviceUnderTest) -> None:
    """Send a request to a node-ID that nobody has."""
    request_id = 0x600 + dut.free_node_id
    dut.wire.forget()
    dut.wire.send(Frame(request_id, upload_request(0x1000)))
    answer = dut.sdo.answer()
    if answer is not None:
        raise Deviation(f"answer {shown(answer)} to a request by 0x{request_id:03X}")


@CHAPTER.check(
    "7.5.2.33", "1200h has the identifiers of the default channel", degree=Degree.OPTIONAL
)
def default_channel(dut: DeviceUnderTest) -> None:
    """Read 1200h, which is there only where the EDS has it."""
    dut.variable(0x1200, 1)
    found = dut.number(0x1200, 1), dut.number(0x1200, 2)
    right = dut.sdo.request_id, dut.sdo.answer_id
    if found != right:
        raise Deviation(f"{found[0]:03X}h and {found[1]:03X}h; {right[0]:03X}h, {right[1]:03X}h")


@CHAPTER.check("7.2.4.2", "a request is served while answers of other nodes pass")
def bystander(dut: DeviceUnderTest) -> None:
    """Read while an answer, a heartbeat and an emergency of a free node-ID are on the bus."""
    other = dut.free_node_id
    dut.wire.send(
        Frame(0x580 + other, upload_request(0x1000)),
        Frame(0x700 + other, b"\x05"),
        Frame(0x080 + other, bytes(8)),
    )
    dut.sdo.upload(0x1000)


@CHAPTER.check("7.2.4.2", "requests that do not wait for their answers leave the server alive")
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
                size = len(dut.sdo.upload(variable.index, variable.subindex))
            except Refused:
                continue
            best = max(best, (variable.index, variable.subindex, size), key=lambda found: found[2])
    if best[2] <= 4:
        raise NotApplicable("no object is longer than 4 bytes")
    return best
