"""Store and restore parameters (CiA 301, 7.5.2.13 and 7.5.2.14)."""

from hil_bench.abilities.conformance.check import Chapter, Impact
from hil_bench.abilities.conformance.device import HEARTBEAT_TIME, DeviceUnderTest
from hil_bench.abilities.conformance.sdo_client import download_request
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable, Refused
from hil_bench.canopen_device.nmt import NmtCommand, NmtState

CHAPTER = Chapter("Store and restore")

_STORE, _RESTORE, _STARTUP = 0x1010, 0x1011, 0x1F80
_NO_SELF_START = 1 << 2
_ALL = 1
_NOT_STORED = (0x08000020, 0x08000021, 0x08000022)
_ON_COMMAND = 1
_TRIAL_MS = 4321
_PATIENCE = 10.0
"""Longest wait until a device has stored its parameters [s]."""


@CHAPTER.check("7.5.2.13", "1010h shows what it can store, in bits 0 and 1")
def store_ability(dut: DeviceUnderTest) -> str:
    """Read 1010h.01."""
    return _ability(dut, _STORE)


@CHAPTER.check("7.5.2.14", "1011h shows whether it can restore, in bit 0")
def restore_ability(dut: DeviceUnderTest) -> str:
    """Read 1011h.01."""
    return _ability(dut, _RESTORE)


@CHAPTER.check("7.5.2.13", "a wrong signature aborts with 0800 0020h to 0022h", Impact.WRITE)
def wrong_signature(dut: DeviceUnderTest) -> None:
    """Write "load" to 1010h and "save" to 1011h."""
    dut.variable(_STORE, _ALL)
    dut.sdo.expect_abort(download_request(_STORE, _ALL, b"load"), *_NOT_STORED)
    if dut.objects.find(_RESTORE, _ALL):
        dut.sdo.expect_abort(download_request(_RESTORE, _ALL, b"save"), *_NOT_STORED)


@CHAPTER.check("7.5.2.13", "what was stored is there after a reset of the node", Impact.STORE)
def store(dut: DeviceUnderTest) -> None:
    """Change 1017h, store, reset; then store what was there before."""
    dut.writable(*HEARTBEAT_TIME)
    _check_ability(dut, _STORE)
    before = dut.number(*HEARTBEAT_TIME)
    dut.write(*HEARTBEAT_TIME, _TRIAL_MS)
    try:
        _command(dut, _STORE, b"save")
        dut.boot(NmtCommand.RESET_NODE)
        found = dut.number(*HEARTBEAT_TIME)
    finally:
        dut.write(*HEARTBEAT_TIME, before)
        _command(dut, _STORE, b"save")
    if found != _TRIAL_MS:
        raise Deviation(f"1017h is {found} after the reset; {_TRIAL_MS} was stored")


@CHAPTER.check(
    "7.5.2.14", "after restore and a reset the defaults of the EDS are there", Impact.STORE
)
def restore(dut: DeviceUnderTest) -> None:
    """Store another 1017h, restore, reset: the default shows after the reset, not before."""
    heartbeat = dut.writable(*HEARTBEAT_TIME)
    if heartbeat.is_open:
        raise NotApplicable("the EDS gives 1017h no default")
    default = int(heartbeat.default)
    _check_ability(dut, _STORE)
    _check_ability(dut, _RESTORE)
    dut.write(*HEARTBEAT_TIME, _TRIAL_MS)
    _command(dut, _STORE, b"save")
    _command(dut, _RESTORE, b"load")
    at_once = dut.number(*HEARTBEAT_TIME)
    dut.boot(NmtCommand.RESET_NODE)
    found = dut.number(*HEARTBEAT_TIME)
    if found != default:
        raise Deviation(f"1017h is {found} after restore and reset; {default} by the EDS")
    if at_once != _TRIAL_MS:
        raise Deviation(f"1017h was {at_once} before the reset; {_TRIAL_MS} is right")


@CHAPTER.check(
    "CiA 302-2, 1F80h", "with bit 2 clear and stored, the node starts by itself", Impact.STORE
)
def self_start(dut: DeviceUnderTest) -> None:
    """Store 1F80h with bit 2 clear, reset the node, look; then with bit 2 set."""
    dut.writable(_STARTUP)
    _check_ability(dut, _STORE)
    dut.need_operational()
    before = dut.number(_STARTUP)
    try:
        for bit, right in ((0, NmtState.OPERATIONAL), (_NO_SELF_START, NmtState.PRE_OPERATIONAL)):
            value = before & ~_NO_SELF_START | bit
            try:
                dut.write(_STARTUP, 0, value)
            except Refused as refused:
                raise NotApplicable(f"the device does not take {value:X}h: {refused}") from None
            _command(dut, _STORE, b"save")
            dut.reset(NmtCommand.RESET_NODE)
            with dut.watched():
                dut.expect_state(right, f"boot-up with 1F80h = {value:X}h")
    finally:
        dut.command(NmtCommand.ENTER_PRE_OPERATIONAL)
        dut.wire.wait(dut.settling)
        dut.write(_STARTUP, 0, before)
        _command(dut, _STORE, b"save")


def _ability(dut: DeviceUnderTest, index: int) -> str:
    dut.variable(index, _ALL)
    found = dut.number(index, _ALL)
    if found & ~3:
        raise Deviation(f"{index:04X}h.01 is {found:08X}h; bits 0 and 1 only")
    return f"{found:X}h"


def _check_ability(dut: DeviceUnderTest, index: int) -> None:
    dut.variable(index, _ALL)
    if not dut.number(index, _ALL) & _ON_COMMAND:
        raise NotApplicable(f"{index:04X}h.01 says that the device does not do it on command")


def _command(dut: DeviceUnderTest, index: int, signature: bytes) -> None:
    """Send a signature in PRE-OPERATIONAL: in OPERATIONAL a device may refuse it.

    Raises:
        Deviation: it is not confirmed.
    """
    dut.command(NmtCommand.ENTER_PRE_OPERATIONAL)
    dut.wire.wait(dut.settling)
    request = download_request(index, _ALL, signature)
    dut.sdo.send(request)
    answer = dut.sdo.answer(timeout=_PATIENCE)
    if answer is None or answer[0] != 0x60:
        shown = "no answer" if answer is None else answer.hex(" ").upper()
        raise Deviation(f"{signature.decode()} to {index:04X}h.01: {shown}; 60 ... is right")
