"""Causes that many checks would find again: a device that leaves OPERATIONAL, or falls silent.

CiA 301 lets a device leave OPERATIONAL by an error of its own (1029h). It then sends no PDO and
takes none: the checks of these would each find a consequence. A device that no longer answers
passes no check at all, and fails none by itself.
"""

import contextlib
from collections.abc import Iterable

from hil_bench.abilities.conformance.device import BOOT_PATIENCE, HEARTBEAT_MS, DeviceUnderTest
from hil_bench.abilities.conformance.sdo_client import upload_request
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.nmt import NmtCommand, NmtState

_NO_ERROR = 0x00
"""First byte of an EMCY code that reports the end of an error, not an error."""


def find_fall(dut: DeviceUnderTest, *, reset: bool = True) -> str:
    """Start the node, watch it, and return why it does not stay OPERATIONAL; empty where it does.

    Args:
        dut: the device; it is in PRE-OPERATIONAL afterwards.
        reset: whether to reset its communication first, and with it what passed before.

    `NotApplicable` where the device reports its state by no service, `Deviation` where it should.
    """
    if reset:
        dut.boot()
    errors_before = _codes(frame for frame in _taken(dut, 0.0) if dut.is_emergency(frame))
    with dut.watched():
        dut.wire.forget()
        dut.command(NmtCommand.START)
        frames = _taken(dut, max(dut.patience, 4 * HEARTBEAT_MS / 1000))
        state = dut.state()
        if state is NmtState.OPERATIONAL:
            return ""
        was_there = any(dut.is_error_control(f) and _is_operational(f) for f in frames)
        errors = _codes(frame for frame in frames if dut.is_emergency(frame))
        if errors and was_there:
            return f"the device leaves OPERATIONAL by EMCY 0x{errors[0]:04X}"
        if errors:
            return f"the device does not become OPERATIONAL: EMCY 0x{errors[0]:04X} after START"
        begin = "leaves OPERATIONAL" if was_there else "does not become OPERATIONAL"
        return f"the device {begin}: {_errors_present(dut, errors_before)}"


def fall_after(dut: DeviceUnderTest) -> str:
    """Return why a device was not OPERATIONAL during a check that has just failed; empty if it was.

    Where it does not recover by a reset, `dut.fall` keeps the cause for the checks to come.
    """
    with contextlib.suppress(Deviation, NotApplicable):
        dut.sdo.abort()
        cause = find_fall(dut, reset=False)
        if not cause:
            return ""
        dut.fall = find_fall(dut)
        return dut.fall or f"{cause}, until its reset"
    return ""


def absence_after(dut: DeviceUnderTest, check: str) -> str:
    """Return that a device has answered nothing since a check has just failed; empty if it answers.

    Args:
        dut: the device; `dut.absence` keeps the cause for the checks to come.
        check: the text of the check.
    """
    deadline = dut.wire.now() + BOOT_PATIENCE
    while dut.wire.now() < deadline:
        if is_there(dut, dut.patience):
            return ""
    dut.absence = f'the device answers no SDO request since the check "{check}"'
    return f"the device answers no SDO request afterwards, for {BOOT_PATIENCE:g} s"


def is_there(dut: DeviceUnderTest, timeout: float) -> bool:
    """Return True if a device answers a read of 1000h, with whatever, within a time [s]."""
    dut.sdo.send(upload_request(0x1000))
    if dut.sdo.answer(timeout=timeout) is None:
        return False
    dut.absence = ""
    dut.wire.forget()
    return True


def _errors_present(dut: DeviceUnderTest, errors_before: list[int]) -> str:
    """Describe the errors that the device reports, where no EMCY followed the command."""
    words = [f"EMCY 0x{code:04X} came before" for code in errors_before[:1]]
    register = dut.number(0x1001)
    if register:
        words.append(f"error register 0x{register:02X}")
    if register and not errors_before and 0x1003 in dut.objects and dut.number(0x1003):
        words.append(f"latest error 0x{dut.number(0x1003, 1) & 0xFFFF:04X}")
    return ", ".join(words) or "it reports no error"


def _taken(dut: DeviceUnderTest, duration: float) -> list[Frame]:
    def is_report(frame: Frame) -> bool:
        return dut.is_emergency(frame) or dut.is_error_control(frame)

    return [arrival.frame for arrival in dut.wire.take_all(is_report, duration)]


def _is_operational(frame: Frame) -> bool:
    return len(frame.data) == 1 and frame.data[0] & 0x7F == NmtState.OPERATIONAL


def _codes(emergencies: Iterable[Frame]) -> list[int]:
    """Return the codes of errors that begin, in order."""
    codes = [int.from_bytes(frame.data[:2], "little") for frame in emergencies]
    return [code for code in codes if code >> 8 != _NO_ERROR]
