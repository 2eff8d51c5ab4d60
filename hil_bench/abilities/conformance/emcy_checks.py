"""EMCY, error register and error history (CiA 301, 7.2.7).

Errors are provoked by a heartbeat that stays out: every device that watches heartbeats can have it.
"""

import contextlib
from collections.abc import Iterator

from hil_bench.abilities.conformance.check import Chapter, Impact
from hil_bench.abilities.conformance.device import DeviceUnderTest
from hil_bench.abilities.conformance.error_control_checks import (
    CONSUMER,
    HEARTBEAT_LOST,
    LOST_AFTER,
    WATCHED_MS,
    beat,
    error_end,
    watched_producer,
)
from hil_bench.abilities.conformance.sdo_client import code_text, download_request
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.nmt import NmtState

CHAPTER = Chapter("EMCY")

_ERROR_REGISTER, _HISTORY, _COB_ID, _INHIBIT_TIME = 0x1001, 0x1003, 0x1014, 0x1015
_INVALID = 1 << 31
_GENERIC, _COMMUNICATION = 0x01, 0x10
_INHIBITED = 0.2
_LATENESS = 0.05
"""By how much the first of two messages may have been late on its way [s]."""


@CHAPTER.check("7.5.2.17", "1014h is 80h + node-ID by default")
def identifier(dut: DeviceUnderTest) -> None:
    """Read 1014h."""
    dut.variable(_COB_ID)
    found = dut.number(_COB_ID)
    if found & 0x7FFFFFFF != 0x80 + dut.node_id:
        raise NotApplicable(f"configured to {found:08X}h")


@CHAPTER.check("7.5.2.4", "writing anything but 0 to 1003h.00 aborts with 0609 0030h", Impact.WRITE)
def history_write(dut: DeviceUnderTest) -> None:
    """Write 1."""
    dut.writable(_HISTORY)
    dut.sdo.expect_abort(download_request(_HISTORY, 0, b"\x01"), 0x06090030, 0x06090031)


@CHAPTER.check("7.2.7.3.1", "EMCY has eight bytes, and the error register of 1001h", Impact.WRITE)
def message(dut: DeviceUnderTest) -> str:
    """Lose a heartbeat; generic and communication bits are set in message and object."""
    with _lost_heartbeat(dut):
        data = dut.emergency(HEARTBEAT_LOST, "a lost heartbeat")
        if len(data) != 8:
            raise Deviation(f"EMCY {data.hex(' ')}; 8 bytes are right")
        register = dut.number(_ERROR_REGISTER)
        if data[2] != register or not register & _GENERIC or not register & _COMMUNICATION:
            raise Deviation(
                f"error register {data[2]:02X}h in EMCY, {register:02X}h in 1001h; both alike with "
                "bits 0 and 4 is right"
            )
        return data.hex(" ").upper()


@CHAPTER.check(
    "7.2.7.1", "when the error is gone, EMCY 0000h and the error register say so", Impact.WRITE
)
def error_reset(dut: DeviceUnderTest) -> str:
    """Lose a heartbeat and send it again."""
    with _lost_heartbeat(dut) as producer:
        dut.emergency(HEARTBEAT_LOST, "a lost heartbeat")
        beat(dut, producer)
        return error_end(dut, "the heartbeat came back", lambda: beat(dut, producer))


@CHAPTER.check(
    "7.5.2.4", "1003h.01 is the latest error, and 0 to 1003h.00 empties the history", Impact.WRITE
)
def history(dut: DeviceUnderTest) -> None:
    """Lose a heartbeat, where nothing of worth is in the history."""
    dut.writable(_HISTORY)
    dut.boot()
    codes = {dut.number(_HISTORY, sub) & 0xFFFF for sub in range(1, dut.number(_HISTORY) + 1)}
    if codes - {HEARTBEAT_LOST, 0x8210, 0x8220, 0x8250}:
        raise NotApplicable("the history holds errors that this suite did not cause")
    with _lost_heartbeat(dut):
        dut.emergency(HEARTBEAT_LOST, "a lost heartbeat")
        latest = dut.number(_HISTORY, 1)
        if latest & 0xFFFF != HEARTBEAT_LOST:
            raise Deviation(f"1003h.01 is {latest:08X}h; xxxx8130h is right")
        dut.write(_HISTORY, 0, 0)
        count = dut.number(_HISTORY)
        if count:
            raise Deviation(f"{count} errors in the history after it was emptied")


@CHAPTER.check("7.5.2.17", "bit 31 of 1014h switches EMCY off", Impact.WRITE)
def switched_off(dut: DeviceUnderTest) -> None:
    """Lose a heartbeat with EMCY off."""
    dut.writable(_COB_ID)
    cob_id = dut.number(_COB_ID)
    with dut.setting(_COB_ID, 0, cob_id | _INVALID), _lost_heartbeat(dut):
        if dut.wire.take(dut.is_emergency, dut.patience) is not None:
            raise Deviation("EMCY came though 1014h has bit 31 set")


@CHAPTER.check("7.5.2.17", "the identifier of a valid EMCY cannot be changed", Impact.WRITE)
def identifier_of_valid(dut: DeviceUnderTest) -> str:
    """Write another identifier: any abort is right."""
    dut.writable(_COB_ID)
    before = dut.number(_COB_ID)
    raw = (before ^ 0x100).to_bytes(4, "little")
    try:
        return code_text(dut.sdo.expect_abort(download_request(_COB_ID, 0, raw)))
    finally:
        if dut.number(_COB_ID) != before:
            dut.write(_COB_ID, 0, before | _INVALID)
            dut.write(_COB_ID, 0, before)


@CHAPTER.check("7.5.2.18", "no two EMCYs within the inhibit time of 1015h", Impact.WRITE)
def inhibit_time(dut: DeviceUnderTest) -> str:
    """Lose a heartbeat and send it again at once, with an inhibit time of 200 ms."""
    dut.writable(_INHIBIT_TIME)
    with dut.setting(_INHIBIT_TIME, 0, 2000):
        producer = watched_producer(dut)
        with dut.setting(CONSUMER, 1, producer << 16 | WATCHED_MS):
            beat(dut, producer)
            dut.wire.forget()
            first = dut.wire.take(dut.is_emergency, WATCHED_MS / 1000 + dut.patience)
            dut.wire.send(Frame(0x700 + producer, bytes([NmtState.OPERATIONAL])))
            second = dut.wire.take(dut.is_emergency, _INHIBITED + dut.patience)
    if first is None or second is None:
        raise Deviation("no EMCY after a lost heartbeat, or none after it came back")
    distance = second.time - first.time
    if distance < _INHIBITED - _LATENESS:
        raise Deviation(f"two EMCYs within {distance * 1000:.0f} ms; 200 ms or more is right")
    return f"{distance * 1000:.0f} ms"


@contextlib.contextmanager
def _lost_heartbeat(dut: DeviceUnderTest) -> Iterator[int]:
    """Send a heartbeat of a free node-ID that the device watches, and stop.

    Yields:
        The node-ID.
    """
    producer = watched_producer(dut)
    with dut.setting(CONSUMER, 1, producer << 16 | WATCHED_MS):
        beat(dut, producer)
        dut.wire.wait(LOST_AFTER)
        yield producer
