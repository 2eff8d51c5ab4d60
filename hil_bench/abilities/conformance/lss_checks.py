"""LSS slave with a node-ID (CiA 305)."""

import contextlib
import struct
from collections.abc import Iterator

from hil_bench.abilities.conformance.check import Chapter
from hil_bench.abilities.conformance.device import DeviceUnderTest
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable, Refused
from hil_bench.abilities.conformance.wire import is_data, shown
from hil_bench.canopen_device.frame import Frame

LSS = Chapter("LSS")

_REQUEST, _ANSWER = 0x7E5, 0x7E4
_SWITCH_GLOBAL, _SELECT, _SELECTED = 0x04, 0x40, 0x44
_CONFIGURE_NODE_ID, _CONFIGURE_BIT_TIMING = 0x11, 0x13
_IDENTIFY, _IDENTIFY_UNCONFIGURED, _IDENTIFIED = 0x46, 0x4C, 0x4F
_FASTSCAN = 0x51
_INQUIRE, _INQUIRE_NODE_ID = 0x5A, 0x5E
_PARTS = range(1, 5)
_BESIDE = 0x55AA0000
"""Turns a serial number into one that nobody on a small bus has."""


@LSS.check("CiA 306, LSS_Supported", "a device that claims LSS answers to it")
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


@LSS.check("CiA 305, switch state selective", "the device's address selects it")
def select(dut: DeviceUnderTest) -> None:
    """Select it by the four entries of 1018h."""
    with _configuring(dut):
        pass


@LSS.check("CiA 305, switch state selective", "another serial number does not")
def select_other(dut: DeviceUnderTest) -> None:
    """Select by a serial number that nobody has."""
    *others, serial = _available(dut)
    answer = _select(dut, (*others, serial ^ _BESIDE))
    _expect_silence(answer, "selection by another serial number")


@LSS.check("CiA 305, inquire identity", "identity and node-ID are answered")
def inquire(dut: DeviceUnderTest) -> None:
    """Ask for the four entries of 1018h and the node-ID."""
    with _configuring(dut) as address:
        for part, right in enumerate((*address, dut.node_id)):
            answer = _exchange(dut, _INQUIRE + part)
            found = int.from_bytes(answer[1:5], "little")
            if found != right:
                request = _padded(_INQUIRE + part)
                raise Deviation(f"{shown(request)}: {found:08X}h; {right:08X}h is right")


@LSS.check("CiA 305, configure node-ID", "an impossible node-ID is refused, its own is taken")
def node_id(dut: DeviceUnderTest) -> None:
    """Configure 0, 128, then the node-ID that the device has."""
    with _configuring(dut):
        for value, right in ((0, 1), (128, 1), (dut.node_id, 0)):
            answer = _exchange(dut, _CONFIGURE_NODE_ID, value)
            if answer[1] != right:
                raise Deviation(f"error code {answer[1]} for node-ID {value}; {right} is right")


@LSS.check("CiA 305, configure bit timing", "a reserved bit timing is refused")
def bit_timing(dut: DeviceUnderTest) -> None:
    """Configure index 5 of the standard table; nothing is activated.

    Raises:
        NotApplicable: the device has no such service, which a device of one bit rate need not have.
        Deviation: it takes the bit timing.
    """
    with _configuring(dut):
        answer = _ask(dut, _CONFIGURE_BIT_TIMING, 0, 5)
        if answer is None:
            raise NotApplicable("no answer: the device does not have this service")
        if answer[:1] != bytes([_CONFIGURE_BIT_TIMING]) or len(answer) != 8:
            raise Deviation(f"answer {shown(answer)}; {_CONFIGURE_BIT_TIMING:02X} ... is right")
        if answer[1] == 0:
            raise Deviation("error code 0 for index 5, which is reserved; 1 is right")


@LSS.check("CiA 305, identify remote slave", "who is in the range says so")
def identify(dut: DeviceUnderTest) -> None:
    """Identify by the device's own address, then by a range of serial numbers beside it.

    Raises:
        NotApplicable: silence: a slave that is selected by its address may lack this service.
        Deviation: another answer, or one to a range that leaves the device out.
    """
    *others, serial = address = _available(dut)
    answer = _identify(dut, address)
    if answer is None:
        raise NotApplicable("no answer: the device does not have this service")
    if answer[:1] != bytes([_IDENTIFIED]):
        raise Deviation(f"answer {shown(answer)}; {_IDENTIFIED:02X} ... is right")
    answer = _identify(dut, (*others, serial ^ _BESIDE))
    _expect_silence(answer, "another serial number")


@LSS.check("CiA 305, fastscan", "a device with a node-ID takes no part")
def configured(dut: DeviceUnderTest) -> None:
    """Begin a fastscan, and ask for devices without node-ID.

    Raises:
        Deviation: it answers a fastscan for its own address.
        NotApplicable: another device answers, or nobody can say who.
    """
    address = _available(dut)
    answer = _ask_fastscan(dut, 0, 0x80, 0, 0)
    if answer is not None and _is_found(dut, address):
        raise Deviation(f"answer {shown(answer)}, though it has node-ID {dut.node_id}")
    if answer is None:
        answer = _ask(dut, _IDENTIFY_UNCONFIGURED)
    if answer is not None:
        raise NotApplicable(f"somebody without node-ID answers: {shown(answer)}")


@LSS.check("CiA 305, switch state global", "in the state WAITING no inquiry is answered")
def waiting(dut: DeviceUnderTest) -> None:
    """Switch all to WAITING, then inquire."""
    _available(dut)
    _wait(dut)
    _expect_silence(_ask(dut, _INQUIRE_NODE_ID), "an inquiry in WAITING")


@contextlib.contextmanager
def _configuring(dut: DeviceUnderTest) -> Iterator[tuple[int, ...]]:
    """Select the device, and send it back to WAITING.

    Yields:
        Its LSS address.
    """
    address = _available(dut)
    answer = _select(dut, address)
    try:
        if answer is None or answer[0] != _SELECTED:
            raise Deviation(f"no answer {_SELECTED:02X}h to a selection by its own address")
        yield address
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
    return _ask(dut, _FASTSCAN, *number.to_bytes(4, "little"), bit_check, part, following)


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


def _available(dut: DeviceUnderTest) -> tuple[int, ...]:
    """Return the LSS address of a device that has LSS; whether it should have it is judged once.

    Raises:
        NotApplicable: it does not answer to its own address by any service.
    """
    address = _address(dut)
    if not _is_available(dut, address):
        raise NotApplicable("the device has no LSS")
    return address


def _is_available(dut: DeviceUnderTest, address: tuple[int, ...]) -> bool:
    """Return True if the device answers to its own address by any service."""
    _wait(dut)
    selected = _select(dut, address)
    _wait(dut)
    return selected is not None or _identify(dut, address) is not None


def _wait(dut: DeviceUnderTest) -> None:
    dut.tell(Frame(_REQUEST, _padded(_SWITCH_GLOBAL)))
    dut.wire.forget()


def _select(dut: DeviceUnderTest, address: tuple[int, ...]) -> bytes | None:
    return _ask_with(dut, _SELECT, address)


def _identify(dut: DeviceUnderTest, address: tuple[int, ...]) -> bytes | None:
    vendor, product, revision, serial = address
    return _ask_with(dut, _IDENTIFY, (vendor, product, revision, revision, serial, serial))


def _ask_with(dut: DeviceUnderTest, first: int, numbers: tuple[int, ...]) -> bytes | None:
    """Send numbers, each by a command specifier of its own, and return the answer to all."""
    for specifier, number in enumerate(numbers, start=first):
        dut.wire.send(Frame(_REQUEST, struct.pack("<BI3x", specifier, number)))
    return _answer(dut)


def _ask(dut: DeviceUnderTest, *request: int) -> bytes | None:
    dut.wire.send(Frame(_REQUEST, _padded(*request)))
    return _answer(dut)


def _padded(*request: int) -> bytes:
    return bytes(request).ljust(8, b"\0")


def _answer(dut: DeviceUnderTest) -> bytes | None:
    arrival = dut.wire.take(lambda frame: is_data(frame, _ANSWER), dut.patience)
    return None if arrival is None else arrival.frame.data


def _exchange(dut: DeviceUnderTest, *request: int) -> bytes:
    answer = _ask(dut, *request)
    if answer is None or len(answer) != 8 or answer[0] != request[0]:
        asked = shown(_padded(*request))
        raise Deviation(f"{asked}: answer {shown(answer or b'')}; {request[0]:02X} ...")
    return answer


def _expect_silence(answer: bytes | None, after: str) -> None:
    if answer is not None:
        raise Deviation(f"answer {shown(answer)} to {after}; silence is right")
