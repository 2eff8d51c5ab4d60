"""TPDO transmission and RPDO reception (CiA 301, 7.2.2, 7.5.2.35 and 7.5.2.37)."""

import contextlib
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Final

from hil_bench.abilities.conformance.check import (
    BEATS,
    TOLERANCE,
    Chapter,
    Degree,
    Impact,
    judge_period,
    median_period,
)
from hil_bench.abilities.conformance.device import DeviceUnderTest
from hil_bench.abilities.conformance.pdo import (
    EVENT_TIMER,
    INHIBIT_TIME,
    INVALID,
    NO_REMOTE,
    RPDOS,
    TPDOS,
    TYPE,
    Pdo,
    every,
    expect_length,
    judge_each,
    sound_pdos,
)
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable, Refused
from hil_bench.abilities.conformance.wire import shown, upload_request
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.nmt import NmtCommand

TPDO = Chapter("TPDO")
RPDO = Chapter("RPDO")

SYNC = Frame(0x080)

_COUNTER_OVERFLOW, _START_VALUE = 0x1019, 6
_NOT_PROCESSED, _TOO_LONG, _TIMED_OUT = 0x8210, 0x8220, 0x8250
_AT_ONCE: Final[Mapping[int, int]] = MappingProxyType({TYPE: 255})
_WINDOW = 0x1007


@TPDO.check("7.5.2.37", "type 1 is sent with every SYNC, as long as its mapping")
@every(TPDOS, TYPE)
def each_sync(dut: DeviceUnderTest, pdo: Pdo) -> str:
    """Send five SYNCs."""
    with pdo.configured({TYPE: 1}), dut.operational():
        counts = sync_counts(dut, pdo, 5)
    if counts != [1] * 5:
        raise Deviation(f"PDOs after each SYNC: {counts}; one each is right")
    return f"{pdo.length} bytes"


@TPDO.check("7.5.2.37", "type 3 is sent with every third SYNC")
@every(TPDOS, TYPE)
def third_sync(dut: DeviceUnderTest, pdo: Pdo) -> None:
    """Send nine SYNCs."""
    with pdo.configured({TYPE: 3}), dut.operational():
        counts = sync_counts(dut, pdo, 9)
    if sum(counts) != 3 or counts[:3] != counts[3:6] or counts[:3] != counts[6:]:
        raise Deviation(f"PDOs after each SYNC: {counts}; one in three is right")


@TPDO.check("7.3.2.3", "no PDO in PRE-OPERATIONAL and STOPPED")
@every(TPDOS, TYPE)
def operational_only(dut: DeviceUnderTest, pdo: Pdo) -> None:
    """Send SYNCs in both states."""
    with pdo.configured({TYPE: 1}):
        for command in (NmtCommand.ENTER_PRE_OPERATIONAL, NmtCommand.STOP):
            dut.command(command)
            dut.wire.wait(dut.settling)
            counts = sync_counts(dut, pdo, 2)
            dut.rest()
            if any(counts):
                raise Deviation(f"a PDO came with SYNC after {command.name}")


@TPDO.check("7.5.2.38", "a PDO carries the values of its objects")
@every(TPDOS, TYPE)
def contents(dut: DeviceUnderTest, pdo: Pdo) -> str:
    """Compare a synchronous PDO with what SDO reads before and after it."""
    with pdo.configured({TYPE: 1}), dut.operational():
        before = pdo.values()
        dut.wire.send(SYNC)
        arrival = dut.wire.take(pdo.matches, dut.patience)
        after = pdo.values()
    if arrival is None:
        raise Deviation("no PDO after a SYNC")
    if before != after:
        raise NotApplicable("the values change too fast to be compared")
    if arrival.frame.data != before:
        raise Deviation(f"PDO {shown(arrival.frame.data)}; {shown(before)} by SDO")
    return shown(before)


@TPDO.check("7.5.2.37", "the event timer sends a PDO of type 254 or 255")
@every(TPDOS, TYPE, EVENT_TIMER)
def event_timer(dut: DeviceUnderTest, pdo: Pdo) -> str:
    """Set 50 ms and take the median of 20 periods."""
    found = []
    for kind, times in _event_times(dut, pdo, {EVENT_TIMER: 50}):
        try:
            found.append(f"type {kind} {judge_period(times, 50)}")
        except Deviation as deviation:
            raise Deviation(f"type {kind}: {deviation}") from None
    return ", ".join(found)


@TPDO.check("7.5.2.37", "no two event-driven PDOs within the inhibit time")
@every(TPDOS, TYPE, EVENT_TIMER, INHIBIT_TIME)
def inhibit_time(dut: DeviceUnderTest, pdo: Pdo) -> str:
    """Set an event timer of 10 ms and an inhibit time of 50 ms."""
    found = []
    for kind, times in _event_times(dut, pdo, {EVENT_TIMER: 10, INHIBIT_TIME: 500}):
        period_ms = median_period(times)
        if period_ms < 50 * (1 - TOLERANCE):
            raise Deviation(f"type {kind}: a PDO every {period_ms:.1f} ms; 50 ms or more is right")
        found.append(f"type {kind} {period_ms:.1f} ms")
    return ", ".join(found)


@TPDO.check("7.2.2.5", "a remote request is answered with the PDO")
@every(TPDOS, TYPE)
def remote_request(dut: DeviceUnderTest, pdo: Pdo) -> str:
    """Allow remote frames, and ask by one, with types 252 (after a SYNC) and 253."""
    taken = []
    for kind in (252, 253):
        try:
            with pdo.configured({TYPE: kind}, clear=INVALID | NO_REMOTE), dut.operational():
                dut.wire.send(SYNC, Frame(pdo.can_id, is_remote=True))
                arrival = dut.wire.take(pdo.matches, dut.patience)
        except Refused:
            continue  # a device need not have these types
        if arrival is None:
            raise Deviation(f"no PDO of type {kind} after a remote request")
        expect_length(pdo, arrival.frame.data)
        taken.append(f"type {kind}")
    if not taken:
        raise NotApplicable("the device refuses types 252 and 253, or bit 30 clear")
    return ", ".join(taken)


@TPDO.check("7.5.2.37", "the SYNC start value is the counter of the first SYNC")
@every(TPDOS, TYPE, _START_VALUE)
def start_value(dut: DeviceUnderTest, pdo: Pdo) -> None:
    """Start with counter 3 of 10, send SYNCs from 1 on."""
    dut.writable(_COUNTER_OVERFLOW)
    with (
        dut.setting(_COUNTER_OVERFLOW, 0, 10),
        pdo.configured({TYPE: 1, _START_VALUE: 3}),
        dut.operational(),
    ):
        counts = [sync_counts(dut, pdo, 1, Frame(0x080, bytes([n])))[0] for n in range(1, 6)]
    if counts != [0, 0, 1, 1, 1]:
        raise Deviation(f"PDOs after SYNC 1 to 5: {counts}; none before 3 is right")


@TPDO.check("7.5.2.37", "reserved transmission types abort with 0609 0030h")
@every(TPDOS, TYPE)
def reserved_types(dut: DeviceUnderTest, pdo: Pdo) -> None:
    """Write 241 and 251; the old type stays."""
    with pdo.disabled():
        dut.expect_kept(pdo.index, TYPE, (241, 251), 0x06090030, 0x06090031)


@TPDO.check("7.5.2.37", "sub-index 4 of a TPDO does not exist", Impact.READ)
def reserved_subindex(dut: DeviceUnderTest) -> str:
    """Read it from every TPDO that the EDS describes without it."""
    found = [i for i in dut.objects.indices(TPDOS) if dut.objects.find(i, 4) is None]
    if not found:
        raise NotApplicable("the EDS has no TPDO, or none without sub-index 4")
    for index in found:
        dut.sdo.expect_abort(upload_request(index, 4), 0x06090011)
    return f"{len(found)} TPDOs"


def sync_counts(dut: DeviceUnderTest, pdo: Pdo, count: int, sync: Frame = SYNC) -> list[int]:
    """Return the number of PDOs after each of some SYNCs; each PDO as long as it should be."""
    room = dut.patience / 10  # for the PDO: a host has its own delays
    dut.wire.take_all(pdo.matches, room)
    counts = []
    for _ in range(count):
        dut.wire.send(sync)
        arrivals = dut.wire.take_all(pdo.matches, room)
        for arrival in arrivals:
            expect_length(pdo, arrival.frame.data)
        counts.append(len(arrivals))
    return counts


def _event_times(
    dut: DeviceUnderTest, pdo: Pdo, values: dict[int, int]
) -> Iterator[tuple[int, list[float]]]:
    """Yield types that the device takes, and the times of event-driven PDOs of each [s].

    Raises:
        Deviation: too few came.
        NotApplicable: the device takes neither type.
    """
    taken = 0
    for kind in (254, 255):
        try:
            with pdo.configured({**values, TYPE: kind}), dut.operational():
                arrivals = [dut.wire.take(pdo.matches, 1.0) for _ in range(BEATS + 3)]
        except Refused:
            continue  # a device need not have both types
        taken += 1
        times = [arrival.time for arrival in arrivals[2:] if arrival is not None]
        if len(times) != BEATS + 1:
            raise Deviation(f"{len(times)} PDOs of type {kind} in {BEATS} s")
        yield kind, times
    if not taken:
        raise NotApplicable("the device refuses transmission types 254 and 255")


# RPDOs.


@RPDO.check("7.5.2.35", "an asynchronous RPDO acts at once")
@every(RPDOS, TYPE)
def asynchronous(dut: DeviceUnderTest, pdo: Pdo) -> str:
    """Send one with a bit of each object changed, read the objects."""
    with _receiving(dut, pdo) as before:
        changed = _changed(dut, pdo, before)
        dut.tell(Frame(pdo.can_id, changed))
        _expect(pdo, changed, "an RPDO")
        return f"{pdo.length} bytes"


@RPDO.check("7.5.2.35", "a synchronous RPDO acts with the next SYNC, not before")
@every(RPDOS, TYPE)
def synchronous(dut: DeviceUnderTest, pdo: Pdo) -> None:
    """Send one, read, send SYNC, read again."""
    with _receiving(dut, pdo, {TYPE: 1}) as before:
        changed = _changed(dut, pdo, before)
        dut.tell(Frame(pdo.can_id, changed))
        _expect(pdo, before, "an RPDO, before SYNC")
        dut.tell(SYNC)
        _expect(pdo, changed, "SYNC")


@RPDO.check("7.5.2.7", "an RPDO within the synchronous window acts, one after it may not")
@every(RPDOS, TYPE)
def synchronous_window(dut: DeviceUnderTest, pdo: Pdo) -> str:
    """Send one 60 ms after SYNC, with a window of 20 ms; then one right after SYNC."""
    dut.writable(_WINDOW)
    with dut.setting(_WINDOW, 0, 20_000), _receiving(dut, pdo, {TYPE: 1}) as before:
        changed = _changed(dut, pdo, before)
        dut.wire.send(SYNC)
        dut.wire.wait(0.06)
        dut.tell(Frame(pdo.can_id, changed))
        dut.tell(SYNC)
        found = pdo.values()
        if found not in {before, changed}:
            _expect(pdo, before, "an RPDO outside the window")
        dut.tell(Frame(pdo.can_id, before))
        dut.wire.send(SYNC, Frame(pdo.can_id, changed))
        dut.wire.wait(0.06)
        dut.tell(SYNC)
        _expect(pdo, changed, "an RPDO within the window")
        return "discarded after the window" if found == before else "kept after the window"


@RPDO.check("7.3.2.3", "an RPDO in PRE-OPERATIONAL or STOPPED does nothing")
@every(RPDOS, TYPE)
def rpdo_operational_only(dut: DeviceUnderTest, pdo: Pdo) -> None:
    """Send one in each state; read the objects in PRE-OPERATIONAL, for STOPPED has no SDO."""
    with pdo.configured(_AT_ONCE):
        before = pdo.values()
        changed = Frame(pdo.can_id, _changed(dut, pdo, before))
        dut.tell(changed)
        _expect(pdo, before, "an RPDO in PRE-OPERATIONAL")
        dut.command(NmtCommand.STOP)
        dut.wire.wait(dut.settling)
        dut.tell(changed)
        dut.rest()
        _expect(pdo, before, "an RPDO in STOPPED")


@RPDO.check("7.2.7.1", "an RPDO that is too short is not processed: EMCY 8210h")
def too_short(dut: DeviceUnderTest) -> str:
    """Send one byte less than the mapping has."""
    codes: list[int] = []

    def judge(pdo: Pdo) -> str:
        with _receiving(dut, pdo) as before:
            dut.wire.send(Frame(pdo.can_id, _changed(dut, pdo, before)[:-1]))
            found = _reported(dut, _NOT_PROCESSED, "a short RPDO", codes)
            _expect(pdo, before, "a short RPDO")
        return found

    return judge_each(judge, sound_pdos(dut, RPDOS, TYPE))


@RPDO.check("7.2.7.1", "an RPDO that is too long is processed; EMCY 8220h may report it")
@every(RPDOS, TYPE)
def too_long(dut: DeviceUnderTest, pdo: Pdo) -> str:
    """Send one byte more than the mapping has."""
    if pdo.length > 7:
        raise NotApplicable("the mapping fills all 8 bytes")
    with _receiving(dut, pdo) as before:
        changed = _changed(dut, pdo, before)
        dut.tell(Frame(pdo.can_id, changed + b"\0"))
        _expect(pdo, changed, "a long RPDO")
        told = dut.wire.take(lambda frame: dut.reports(frame, _TOO_LONG), 0.05)
        return "EMCY 8220h" if told else "no EMCY"


@RPDO.check("7.5.2.35", "within the event timer of an RPDO there is no EMCY")
@every(RPDOS, TYPE, EVENT_TIMER)
def in_time(dut: DeviceUnderTest, pdo: Pdo) -> None:
    """Send one, and listen for 200 ms; the timer is 500 ms."""
    with _receiving(dut, pdo, {**_AT_ONCE, EVENT_TIMER: 500}) as before:
        dut.wire.send(Frame(pdo.can_id, before))
        if dut.wire.take(dut.is_error, 0.2) is not None:
            raise Deviation("EMCY within the time")


@RPDO.check(
    "7.5.2.35",
    "an RPDO that stays out beyond its event timer: EMCY 8250h",
    degree=Degree.RECOMMENDED,
)
def deadline(dut: DeviceUnderTest) -> str:
    """Send one, then no more; the timer is 500 ms."""
    codes: list[int] = []

    def judge(pdo: Pdo) -> str:
        with _receiving(dut, pdo, {**_AT_ONCE, EVENT_TIMER: 500}) as before:
            dut.wire.send(Frame(pdo.can_id, before))
            dut.wire.wait(0.5)
            return _reported(dut, _TIMED_OUT, "500 ms without an RPDO", codes)

    return judge_each(judge, sound_pdos(dut, RPDOS, TYPE, EVENT_TIMER))


@RPDO.check("7.2.2.5", "remote and 29-bit frames with its identifier are no RPDO")
@every(RPDOS, TYPE)
def strange_frames(dut: DeviceUnderTest, pdo: Pdo) -> None:
    """Send both, read the objects."""
    with _receiving(dut, pdo) as before:
        dut.wire.send(
            Frame(pdo.can_id, is_remote=True),
            Frame(pdo.can_id, _changed(dut, pdo, before), is_extended=True),
        )
        dut.wire.wait(dut.settling)
        _expect(pdo, before, "frames that are no RPDO")


@contextlib.contextmanager
def _receiving(
    dut: DeviceUnderTest, pdo: Pdo, values: Mapping[int, int] = _AT_ONCE
) -> Iterator[bytes]:
    """Have the device receive a PDO with these parameters, and restore its objects.

    Yields:
        What its objects held.
    """
    with pdo.configured(values, clear=INVALID), dut.operational():
        before = pdo.values()
        try:
            yield before
        finally:
            dut.tell(Frame(pdo.can_id, before))
            dut.tell(SYNC)


def _reported(dut: DeviceUnderTest, code: int, cause: str, codes: list[int]) -> str:
    """Return the EMCY that reports an error, in words, and add its code to those that came.

    One that came already need not come again: a device may keep the error until a reset (7.2.7.1).
    """
    if not codes:
        dut.emergency(code, cause)
        codes.append(code)
    elif dut.wire.take(lambda frame: dut.reports(frame, code), dut.patience) is None:
        return f"no further EMCY {code:04X}h"
    return f"EMCY {code:04X}h"


def _changed(dut: DeviceUnderTest, pdo: Pdo, before: bytes) -> bytes:
    """Return other values that lie within the limits of the EDS.

    Raises:
        NotApplicable: there are none.
    """
    data, offset = bytearray(before), 0
    for entry in pdo.entries:
        raw = before[offset : offset + entry.bits // 8]
        variable = dut.variable(*entry.key)
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
