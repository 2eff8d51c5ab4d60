"""TPDO transmission (CiA 301, 7.2.2 and 7.5.2.37)."""

from itertools import pairwise
from statistics import median

from hil_bench.abilities.conformance.check import Chapter, Impact
from hil_bench.abilities.conformance.device import DeviceUnderTest
from hil_bench.abilities.conformance.pdo import (
    EVENT_TIMER,
    INHIBIT_TIME,
    INVALID,
    NO_REMOTE,
    TPDOS,
    TYPE,
    Pdo,
    expect_length,
    first_pdo,
)
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable, Refused
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.nmt import NmtCommand

CHAPTER = Chapter("TPDO")

SYNC = Frame(0x080)

_COUNTER_OVERFLOW, _START_VALUE = 0x1019, 6

_BEATS = 20
_TOLERANCE = 0.1


@CHAPTER.check("7.5.2.37", "type 1 is sent with every SYNC, as long as its mapping", Impact.WRITE)
def each_sync(dut: DeviceUnderTest) -> str:
    """Send five SYNCs."""
    pdo = first_pdo(dut, TPDOS, TYPE)
    with pdo.configured({TYPE: 1}), dut.operational():
        counts = sync_counts(dut, pdo, 5)
    if counts != [1] * 5:
        raise Deviation(f"PDOs after each SYNC: {counts}; one each is right")
    return f"{pdo.index:04X}h, {pdo.length} bytes"


@CHAPTER.check("7.5.2.37", "type 3 is sent with every third SYNC", Impact.WRITE)
def third_sync(dut: DeviceUnderTest) -> None:
    """Send nine SYNCs."""
    pdo = first_pdo(dut, TPDOS, TYPE)
    with pdo.configured({TYPE: 3}), dut.operational():
        counts = sync_counts(dut, pdo, 9)
    if sum(counts) != 3 or counts[:3] != counts[3:6] or counts[:3] != counts[6:]:
        raise Deviation(f"PDOs after each SYNC: {counts}; one in three is right")


@CHAPTER.check("7.3.2.3", "no PDO in PRE-OPERATIONAL and STOPPED", Impact.WRITE)
def operational_only(dut: DeviceUnderTest) -> None:
    """Send SYNCs in both states."""
    pdo = first_pdo(dut, TPDOS, TYPE)
    with pdo.configured({TYPE: 1}):
        for command in (NmtCommand.ENTER_PRE_OPERATIONAL, NmtCommand.STOP):
            dut.command(command)
            dut.wire.wait(dut.settling)
            counts = sync_counts(dut, pdo, 2)
            dut.command(NmtCommand.ENTER_PRE_OPERATIONAL)
            dut.wire.wait(dut.settling)
            if any(counts):
                raise Deviation(f"a PDO came with SYNC after {command.name}")


@CHAPTER.check("7.5.2.38", "a PDO carries the values of its objects", Impact.WRITE)
def contents(dut: DeviceUnderTest) -> None:
    """Compare a synchronous PDO with what SDO reads before and after it."""
    pdo = first_pdo(dut, TPDOS, TYPE)
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
        raise Deviation(f"PDO {arrival.frame.data.hex(' ')}; {before.hex(' ')} by SDO")


@CHAPTER.check("7.5.2.37", "the event timer sends a PDO of type 254 or 255", Impact.WRITE)
def event_timer(dut: DeviceUnderTest) -> str:
    """Set 50 ms and take the median of 20 periods."""
    period_ms = _median_period(dut, {EVENT_TIMER: 50})
    if abs(period_ms - 50) > 50 * _TOLERANCE:
        raise Deviation(f"period {period_ms:.1f} ms; 50 ms is right")
    return f"{period_ms:.1f} ms"


@CHAPTER.check("7.5.2.37", "no two event-driven PDOs within the inhibit time", Impact.WRITE)
def inhibit_time(dut: DeviceUnderTest) -> str:
    """Set an event timer of 10 ms and an inhibit time of 50 ms."""
    first_pdo(dut, TPDOS, TYPE, EVENT_TIMER, INHIBIT_TIME)
    period_ms = _median_period(dut, {EVENT_TIMER: 10, INHIBIT_TIME: 500})
    if period_ms < 50 * (1 - _TOLERANCE):
        raise Deviation(f"a PDO every {period_ms:.1f} ms; 50 ms or more is right")
    return f"{period_ms:.1f} ms"


@CHAPTER.check("7.2.2.5", "a remote request is answered with the PDO", Impact.WRITE)
def remote_request(dut: DeviceUnderTest) -> str:
    """Allow remote frames, and ask by one, with types 252 (after a SYNC) and 253."""
    pdo = first_pdo(dut, TPDOS, TYPE)
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


@CHAPTER.check("7.5.2.37", "the SYNC start value is the counter of the first SYNC", Impact.WRITE)
def start_value(dut: DeviceUnderTest) -> None:
    """Start with counter 3 of 10, send SYNCs from 1 on."""
    dut.writable(_COUNTER_OVERFLOW)
    pdo = first_pdo(dut, TPDOS, TYPE, _START_VALUE)
    with (
        dut.setting(_COUNTER_OVERFLOW, 0, 10),
        pdo.configured({TYPE: 1, _START_VALUE: 3}),
        dut.operational(),
    ):
        counts = [sync_counts(dut, pdo, 1, Frame(0x080, bytes([n])))[0] for n in range(1, 6)]
    if counts != [0, 0, 1, 1, 1]:
        raise Deviation(f"PDOs after SYNC 1 to 5: {counts}; none before 3 is right")


@CHAPTER.check("7.5.2.37", "reserved transmission types abort with 0609 0030h", Impact.WRITE)
def reserved_types(dut: DeviceUnderTest) -> None:
    """Write 241 and 251; the old type stays."""
    pdo = first_pdo(dut, TPDOS, TYPE)
    with pdo.disabled():
        before = dut.number(pdo.index, TYPE)
        for value in (241, 251):
            request = bytes([0x2F, pdo.index & 0xFF, pdo.index >> 8, TYPE, value, 0, 0, 0])
            try:
                dut.sdo.expect_abort(request, 0x06090030, 0x06090031)
            finally:
                if dut.number(pdo.index, TYPE) != before:
                    dut.write(pdo.index, TYPE, before)


@CHAPTER.check("7.5.2.37", "sub-index 4 of a TPDO does not exist")
def reserved_subindex(dut: DeviceUnderTest) -> str:
    """Read it from every TPDO that the EDS describes without it."""
    found = [i for i in dut.objects.indices(TPDOS) if dut.objects.find(i, 4) is None]
    if not found:
        raise NotApplicable("the EDS has no TPDO, or none without sub-index 4")
    for index in found:
        dut.sdo.expect_abort(bytes([0x40, index & 0xFF, index >> 8, 4, 0, 0, 0, 0]), 0x06090011)
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


def _median_period(dut: DeviceUnderTest, values: dict[int, int]) -> float:
    """Return the median time between PDOs with these parameters [ms]."""
    pdo = first_pdo(dut, TPDOS, TYPE, *values)
    for kind in (254, 255):
        try:
            with pdo.configured({**values, TYPE: kind}), dut.operational():
                arrivals = [dut.wire.take(pdo.matches, 1.0) for _ in range(_BEATS + 3)]
        except Refused:
            continue  # a device need not have both types
        times = [arrival.time for arrival in arrivals[2:] if arrival is not None]
        if len(times) != _BEATS + 1:
            raise Deviation(f"{len(times)} PDOs of type {kind} in {_BEATS} s")
        return median(b - a for a, b in pairwise(times)) * 1000
    raise NotApplicable("the device refuses transmission types 254 and 255")
