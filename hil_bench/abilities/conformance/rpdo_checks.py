"""RPDO reception (CiA 301, 7.2.2 and 7.5.2.35)."""

import contextlib
from collections.abc import Iterator

from hil_bench.abilities.conformance.check import Chapter, Degree, Impact
from hil_bench.abilities.conformance.device import DeviceUnderTest
from hil_bench.abilities.conformance.pdo import EVENT_TIMER, INVALID, RPDOS, TYPE, Pdo, first_pdo
from hil_bench.abilities.conformance.tpdo_checks import SYNC
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable
from hil_bench.canopen_device.frame import Frame

CHAPTER = Chapter("RPDO")

_NOT_PROCESSED, _TOO_LONG, _TIMED_OUT = 0x8210, 0x8220, 0x8250
_ASYNCHRONOUS = 255
_WINDOW = 0x1007


@CHAPTER.check("7.5.2.35", "an asynchronous RPDO acts at once", Impact.WRITE)
def asynchronous(dut: DeviceUnderTest) -> str:
    """Send one with a bit of each object changed, read the objects."""
    pdo = first_pdo(dut, RPDOS, TYPE)
    with _receiving(dut, pdo, {TYPE: _ASYNCHRONOUS}) as before:
        _send(dut, pdo, _changed(dut, pdo, before))
        _expect(pdo, _changed(dut, pdo, before), "an RPDO")
        return f"{pdo.index:04X}h, {pdo.length} bytes"


@CHAPTER.check("7.5.2.35", "a synchronous RPDO acts with the next SYNC, not before", Impact.WRITE)
def synchronous(dut: DeviceUnderTest) -> None:
    """Send one, read, send SYNC, read again."""
    pdo = first_pdo(dut, RPDOS, TYPE)
    with _receiving(dut, pdo, {TYPE: 1}) as before:
        changed = _changed(dut, pdo, before)
        _send(dut, pdo, changed)
        _expect(pdo, before, "an RPDO, before SYNC")
        dut.wire.send(SYNC)
        dut.wire.wait(dut.settling)
        _expect(pdo, changed, "SYNC")


@CHAPTER.check(
    "7.5.2.7", "an RPDO within the synchronous window acts, one after it may not", Impact.WRITE
)
def synchronous_window(dut: DeviceUnderTest) -> str:
    """Send one 60 ms after SYNC, with a window of 20 ms; then one right after SYNC."""
    dut.writable(_WINDOW)
    pdo = first_pdo(dut, RPDOS, TYPE)
    with dut.setting(_WINDOW, 0, 20_000), _receiving(dut, pdo, {TYPE: 1}) as before:
        changed = _changed(dut, pdo, before)
        dut.wire.send(SYNC)
        dut.wire.wait(0.06)
        _send(dut, pdo, changed)
        dut.wire.send(SYNC)
        dut.wire.wait(dut.settling)
        found = pdo.values()
        if found not in {before, changed}:
            _expect(pdo, before, "an RPDO outside the window")
        _send(dut, pdo, before)
        dut.wire.send(SYNC, Frame(pdo.can_id, changed))
        dut.wire.wait(0.06)
        dut.wire.send(SYNC)
        dut.wire.wait(dut.settling)
        _expect(pdo, changed, "an RPDO within the window")
        return "discarded after the window" if found == before else "kept after the window"


@CHAPTER.check("7.3.2.3", "an RPDO in PRE-OPERATIONAL does nothing", Impact.WRITE)
def operational_only(dut: DeviceUnderTest) -> None:
    """Send one, read the objects."""
    pdo = first_pdo(dut, RPDOS, TYPE)
    with pdo.configured({TYPE: _ASYNCHRONOUS}):
        before = pdo.values()
        _send(dut, pdo, _changed(dut, pdo, before))
        _expect(pdo, before, "an RPDO in PRE-OPERATIONAL")


@CHAPTER.check("7.2.7.1", "an RPDO that is too short is not processed: EMCY 8210h", Impact.WRITE)
def too_short(dut: DeviceUnderTest) -> None:
    """Send one byte less than the mapping has."""
    pdo = first_pdo(dut, RPDOS, TYPE)
    with _receiving(dut, pdo, {TYPE: _ASYNCHRONOUS}) as before:
        dut.wire.send(Frame(pdo.can_id, _changed(dut, pdo, before)[:-1]))
        dut.emergency(_NOT_PROCESSED, "a short RPDO")
        _expect(pdo, before, "a short RPDO")


@CHAPTER.check(
    "7.2.7.1", "an RPDO that is too long is processed; EMCY 8220h may report it", Impact.WRITE
)
def too_long(dut: DeviceUnderTest) -> str:
    """Send one byte more than the mapping has."""
    pdo = first_pdo(dut, RPDOS, TYPE)
    if pdo.length > 7:
        raise NotApplicable("the mapping fills all 8 bytes")
    with _receiving(dut, pdo, {TYPE: _ASYNCHRONOUS}) as before:
        changed = _changed(dut, pdo, before)
        _send(dut, pdo, changed + b"\0")
        _expect(pdo, changed, "a long RPDO")
        told = dut.wire.take(
            lambda frame: (
                dut.is_emergency(frame) and frame.data[:2] == _TOO_LONG.to_bytes(2, "little")
            ),
            0.05,
        )
        return "EMCY 8220h" if told else "no EMCY"


@CHAPTER.check("7.5.2.35", "within the event timer of an RPDO there is no EMCY", Impact.WRITE)
def in_time(dut: DeviceUnderTest) -> None:
    """Send one, and listen for 200 ms; the timer is 500 ms."""
    pdo = first_pdo(dut, RPDOS, TYPE, EVENT_TIMER)
    with _receiving(dut, pdo, {TYPE: _ASYNCHRONOUS, EVENT_TIMER: 500}) as before:
        dut.wire.send(Frame(pdo.can_id, before))
        if dut.wire.take(dut.is_error, 0.2) is not None:
            raise Deviation("EMCY within the time")


@CHAPTER.check(
    "7.5.2.35",
    "an RPDO that stays out beyond its event timer: EMCY 8250h",
    Impact.WRITE,
    Degree.RECOMMENDED,
)
def deadline(dut: DeviceUnderTest) -> None:
    """Send one, then no more; the timer is 500 ms."""
    pdo = first_pdo(dut, RPDOS, TYPE, EVENT_TIMER)
    with _receiving(dut, pdo, {TYPE: _ASYNCHRONOUS, EVENT_TIMER: 500}) as before:
        dut.wire.send(Frame(pdo.can_id, before))
        dut.wire.wait(0.5)
        dut.emergency(_TIMED_OUT, "500 ms without an RPDO")


@CHAPTER.check("7.2.2.5", "remote and 29-bit frames with its identifier are no RPDO", Impact.WRITE)
def strange_frames(dut: DeviceUnderTest) -> None:
    """Send both, read the objects."""
    pdo = first_pdo(dut, RPDOS, TYPE)
    with _receiving(dut, pdo, {TYPE: _ASYNCHRONOUS}) as before:
        dut.wire.send(
            Frame(pdo.can_id, is_remote=True),
            Frame(pdo.can_id, _changed(dut, pdo, before), is_extended=True),
        )
        dut.wire.wait(dut.settling)
        _expect(pdo, before, "frames that are no RPDO")


@contextlib.contextmanager
def _receiving(dut: DeviceUnderTest, pdo: Pdo, values: dict[int, int]) -> Iterator[bytes]:
    """Have the device receive a PDO, and restore its objects.

    Yields:
        What they held.
    """
    with pdo.configured(values, clear=INVALID), dut.operational():
        before = pdo.values()
        try:
            yield before
        finally:
            _send(dut, pdo, before)
            dut.wire.send(SYNC)
            dut.wire.wait(dut.settling)


def _send(dut: DeviceUnderTest, pdo: Pdo, data: bytes) -> None:
    dut.wire.send(Frame(pdo.can_id, data))
    dut.wire.wait(dut.settling)


def _changed(dut: DeviceUnderTest, pdo: Pdo, before: bytes) -> bytes:
    """Return other values that lie within the limits of the EDS.

    Raises:
        NotApplicable: there are none.
    """
    data, offset = bytearray(before), 0
    for entry in pdo.entries:
        raw = before[offset : offset + entry.bits // 8]
        variable = dut.variable(entry.index, entry.subindex)
        other = variable.data_type.decode(bytes([raw[0] ^ 1]) + raw[1:])
        low, high = variable.low, variable.high
        if (
            isinstance(other, int)
            and (low is None or other >= low)
            and (high is None or other <= high)
        ):
            data[offset] ^= 1
        offset += len(raw)
    if data == before:
        raise NotApplicable("what the RPDO carries cannot be changed within its limits")
    return bytes(data)


def _expect(pdo: Pdo, right: bytes, after: str) -> None:
    found = pdo.values()
    if found != right:
        raise Deviation(f"after {after} its objects hold {found.hex(' ')}; {right.hex(' ')}")
