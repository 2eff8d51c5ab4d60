"""LSS slave with a node-ID (CiA 305)."""

import contextlib
import struct
from collections.abc import Iterator

from hil_bench.abilities.conformance.check import Chapter, Impact
from hil_bench.abilities.conformance.device import DeviceUnderTest, is_data
from hil_bench.abilities.conformance.sdo_client import shown
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable, Refused
from hil_bench.canopen_device.frame import Frame

CHAPTER = Chapter("LSS")

_REQUEST, _ANSWER = 0x7E5, 0x7E4
_SWITCH_GLOBAL, _SELECT, _SELECTED = 0x04, 0x40, 0x44
_CONFIGURE_NODE_ID, _CONFIGURE_BIT_TIMING = 0x11, 0x13
_IDENTIFY, _IDENTIFY_UNCONFIGURED, _IDENTIFIED = 0x46, 0x4C, 0x4F
_FASTSCAN = 0x51
_INQUIRE, _INQUIRE_NODE_ID = 0x5A, 0x5E
_PARTS = range(1, 5)
_BESIDE = 0x55AA0000
"""Turns a serial number into one that nobody on a small bus has."""


@CHAPTER.check("CiA 306, LSS_Supported", "a device that claims LSS answers to it", Impact.WRITE)
def claimed(dut: DeviceUnderTest) -> str:
    """Select and identify it by its own address, where the EDS says LSS_Supported=1.

    Raises:
        Deviation: it claims LSS, and answers neither.
    """
    is_there = _is_available(dut, _address(dut))
    if not is_there and dut.objects.claims_lss:
        raise Deviation("no answer to its own address, though the EDS says LSS_Supported=1")
    if not is_there:
        raise NotApplicable("the EDS does not say LSS_Supported=1")
    return "" if dut.objects.claims_lss else "though the EDS does not say LSS_Supported=1"


@CHAPTER.check("CiA 305, switch state selective", "the device's address selects it", Impact.WRITE)
def select(dut: DeviceUnderTest) -> None:
    """Select it by the four entries of 1018h."""
    with _configuring(dut, _address(dut)):
        pass


@CHAPTER.check("CiA 305, switch state selective", "another serial number does not", Impact.WRITE)
def select_other(dut: DeviceUnderTest) -> None:
    """Select by a serial number that nobody has."""
    vendor, product, revision, serial = _address(dut)
    _check_available(dut, (vendor, product, revision, serial))
    _send_address(dut, (vendor, product, revision, serial ^ _BESIDE))
    _expect_silence(dut, "selection by another serial number")


@CHAPTER.check("CiA 305, inquire identity", "identity and node-ID are answered", Impact.WRITE)
def inquire(dut: DeviceUnderTest) -> None:
    """Ask for the four entries of 1018h and the node-ID."""
    address = _address(dut)
    with _configuring(dut, address):
        for part, right in enumerate(address):
            _expect(dut, struct.pack("<BI3x", _INQUIRE + part, 0), right)
        _expect(dut, bytes([_INQUIRE_NODE_ID, *bytes(7)]), dut.node_id)


@CHAPTER.check(
    "CiA 305, configure node-ID", "an impossible node-ID is refused, its own is taken", Impact.WRITE
)
def node_id(dut: DeviceUnderTest) -> None:
    """Configure 0, 128, then the node-ID that the device has."""
    with _configuring(dut, _address(dut)):
        for value, right in ((0, 1), (128, 1), (dut.node_id, 0)):
            answer = _exchange(dut, bytes([_CONFIGURE_NODE_ID, value, *bytes(6)]))
            if answer[1] != right:
                raise Deviation(f"error code {answer[1]} for node-ID {value}; {right} is right")


@CHAPTER.check("CiA 305, configure bit timing", "a reserved bit timing is refused", Impact.WRITE)
def bit_timing(dut: DeviceUnderTest) -> None:
    """Configure index 5 of the standard table; nothing is activated.

    Raises:
        NotApplicable: the device has no such service, which a device of one bit rate need not have.
        Deviation: it takes the bit timing.
    """
    with _configuring(dut, _address(dut)):
        dut.wire.send(Frame(_REQUEST, bytes([_CONFIGURE_BIT_TIMING, 0, 5, *bytes(5)])))
        answer = _answer(dut)
        if answer is None:
            raise NotApplicable("no answer: the device does not have this service")
        if answer[:1] != bytes([_CONFIGURE_BIT_TIMING]) or len(answer) != 8:
            raise Deviation(f"answer {shown(answer)}; {_CONFIGURE_BIT_TIMING:02X} ... is right")
        if answer[1] == 0:
            raise Deviation("error code 0 for index 5, which is reserved; 1 is right")


@CHAPTER.check("CiA 305, identify remote slave", "who is in the range says so", Impact.WRITE)
def identify(dut: DeviceUnderTest) -> None:
    """Identify by the device's own address, then by a range of serial numbers beside it.

    Raises:
        NotApplicable: silence: a slave that is selected by its address may lack this service.
        Deviation: another answer, or one to a range that leaves the device out.
    """
    vendor, product, revision, serial = _address(dut)
    _check_available(dut, (vendor, product, revision, serial))
    _send_numbers(dut, _IDENTIFY, (vendor, product, revision, revision, serial, serial))
    answer = _answer(dut)
    if answer is None:
        raise NotApplicable("no answer: the device does not have this service")
    if answer[:1] != bytes([_IDENTIFIED]):
        raise Deviation(f"answer {shown(answer)}; {_IDENTIFIED:02X} ... is right")
    beside = serial ^ _BESIDE
    _send_numbers(dut, _IDENTIFY, (vendor, product, revision, revision, beside, beside))
    _expect_silence(dut, "another serial number")


@CHAPTER.check("CiA 305, fastscan", "a device with a node-ID takes no part", Impact.WRITE)
def configured(dut: DeviceUnderTest) -> None:
    """Begin a fastscan, and ask for devices without node-ID.

    Raises:
        Deviation: it answers a fastscan for its own address.
        NotApplicable: another device answers, or nobody can say who.
    """
    address = _address(dut)
    _check_available(dut, address)
    answer = _ask_fastscan(dut, 0, 0x80, 0, 0)
    if answer is not None and _is_found(dut, address):
        raise Deviation(f"answer {shown(answer)}, though it has node-ID {dut.node_id}")
    if answer is None:
        dut.wire.send(Frame(_REQUEST, bytes([_IDENTIFY_UNCONFIGURED, *bytes(7)])))
        answer = _answer(dut)
    if answer is not None:
        raise NotApplicable(f"somebody without node-ID answers: {shown(answer)}")


@CHAPTER.check(
    "CiA 305, switch state global", "in the state WAITING no inquiry is answered", Impact.WRITE
)
def waiting(dut: DeviceUnderTest) -> None:
    """Switch all to WAITING, then inquire."""
    _check_available(dut, _address(dut))
    _wait(dut)
    dut.wire.send(Frame(_REQUEST, bytes([_INQUIRE_NODE_ID, *bytes(7)])))
    _expect_silence(dut, "an inquiry in WAITING")


@contextlib.contextmanager
def _configuring(dut: DeviceUnderTest, address: tuple[int, ...]) -> Iterator[None]:
    """Select the device, and send it back to WAITING."""
    _check_available(dut, address)
    _send_address(dut, address)
    answer = _answer(dut)
    try:
        if answer is None or answer[0] != _SELECTED:
            raise Deviation(f"no answer {_SELECTED:02X}h to a selection by its own address")
        yield
    finally:
        _wait(dut)


def _is_found(dut: DeviceUnderTest, address: tuple[int, ...]) -> bool:
    """Return True if the device at an LSS address takes part in the fastscan that has begun.

    All bits of the four numbers are asked for. The last step asks for the same number next, so that
    nobody is switched to CONFIGURATION.
    """
    last = len(address) - 1
    return all(
        _ask_fastscan(dut, number, 0, part, min(part + 1, last)) is not None
        for part, number in enumerate(address)
    )


def _ask_fastscan(
    dut: DeviceUnderTest, number: int, bit_check: int, part: int, following: int
) -> bytes | None:
    request = struct.pack("<BIBBB", _FASTSCAN, number, bit_check, part, following)
    dut.wire.send(Frame(_REQUEST, request))
    return _answer(dut)


def _address(dut: DeviceUnderTest) -> tuple[int, ...]:
    """Return the LSS address.

    Raises:
        NotApplicable: 1018h is not complete.
    """
    for part in _PARTS:
        dut.variable(0x1018, part)
    try:
        return tuple(dut.number(0x1018, part) for part in _PARTS)
    except Refused as refused:
        raise NotApplicable(f"1018h is not complete: {refused}") from None


def _check_available(dut: DeviceUnderTest, address: tuple[int, ...]) -> None:
    """Leave a device without LSS alone; whether it should have it is judged once.

    Raises:
        NotApplicable: it does not answer to its own address by any service.
    """
    if not _is_available(dut, address):
        raise NotApplicable("the device has no LSS")


def _is_available(dut: DeviceUnderTest, address: tuple[int, ...]) -> bool:
    """Return True if the device answers to its own address by any service."""
    _wait(dut)
    _send_address(dut, address)
    selected = _answer(dut)
    _wait(dut)
    if selected is not None:
        return True
    vendor, product, revision, serial = address
    _send_numbers(dut, _IDENTIFY, (vendor, product, revision, revision, serial, serial))
    return _answer(dut) is not None


def _wait(dut: DeviceUnderTest) -> None:
    dut.wire.send(Frame(_REQUEST, bytes([_SWITCH_GLOBAL, 0, *bytes(6)])))
    dut.wire.wait(dut.settling)
    dut.wire.forget()


def _send_address(dut: DeviceUnderTest, address: tuple[int, ...]) -> None:
    _send_numbers(dut, _SELECT, address)


def _send_numbers(dut: DeviceUnderTest, first: int, numbers: tuple[int, ...]) -> None:
    for specifier, number in enumerate(numbers, start=first):
        dut.wire.send(Frame(_REQUEST, struct.pack("<BI3x", specifier, number)))


def _answer(dut: DeviceUnderTest) -> bytes | None:
    arrival = dut.wire.take(lambda frame: is_data(frame, _ANSWER), dut.patience)
    return None if arrival is None else arrival.frame.data


def _exchange(dut: DeviceUnderTest, request: bytes) -> bytes:
    dut.wire.send(Frame(_REQUEST, request))
    answer = _answer(dut)
    if answer is None or len(answer) != 8 or answer[0] != request[0]:
        raise Deviation(f"{shown(request)}: answer {shown(answer or b'')}; {request[0]:02X} ...")
    return answer


def _expect(dut: DeviceUnderTest, request: bytes, right: int) -> None:
    answer = _exchange(dut, request)
    found = int.from_bytes(answer[1:5], "little")
    if found != right:
        raise Deviation(f"{shown(request)}: {found:08X}h; {right:08X}h is right")


def _expect_silence(dut: DeviceUnderTest, after: str) -> None:
    answer = _answer(dut)
    if answer is not None:
        raise Deviation(f"answer {shown(answer)} to {after}; silence is right")
