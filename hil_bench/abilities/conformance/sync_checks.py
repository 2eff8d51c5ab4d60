"""SYNC consumer and producer, TIME (CiA 301, 7.2.5 and 7.2.6)."""

from itertools import pairwise

from hil_bench.abilities.conformance.check import BEATS, Chapter, Impact, judge_period
from hil_bench.abilities.conformance.device import DeviceUnderTest
from hil_bench.abilities.conformance.pdo import TPDOS, TYPE, first_pdo
from hil_bench.abilities.conformance.pdo_checks import sync_counts
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable, Refused
from hil_bench.abilities.conformance.wire import code_text, is_data
from hil_bench.canopen_device.frame import Frame

SYNC = Chapter("SYNC and TIME")

_COB_ID_SYNC, _CYCLE_PERIOD, _COUNTER_OVERFLOW, _COB_ID_TIME = 0x1005, 0x1006, 0x1019, 0x1012
_PRODUCER, _CONSUMER = 1 << 30, 1 << 31
_SYNC = 0x080
_OTHER = 0x6D2
"""An identifier that the predefined connection set leaves free."""

_VALUE, _DEVICE_STATE = (0x06090030, 0x06090031, 0x06090032), 0x08000022
_PERIOD_US = 20_000


@SYNC.check("7.5.2.5", "1005h is 80h by default", Impact.READ)
def identifier(dut: DeviceUnderTest) -> None:
    """Read 1005h."""
    dut.variable(_COB_ID_SYNC)
    found = dut.number(_COB_ID_SYNC)
    if found & 0x7FF != _SYNC:
        raise NotApplicable(f"configured to {found:08X}h")


@SYNC.check("7.5.2.5", "the device follows the identifier of 1005h")
def other_identifier(dut: DeviceUnderTest) -> str:
    """Give SYNC another identifier: it counts, and the old one does not."""
    dut.writable(_COB_ID_SYNC)
    pdo = first_pdo(dut, TPDOS, TYPE)
    with dut.setting(_COB_ID_SYNC, 0, _OTHER), pdo.configured({TYPE: 1}), dut.operational():
        counts = sync_counts(dut, pdo, 3, Frame(_OTHER)), sync_counts(dut, pdo, 3)
    if counts != ([1] * 3, [0] * 3):
        raise Deviation(f"PDOs after SYNC by the new and the old identifier: {counts}")
    return f"by {pdo.index:04X}h"


@SYNC.check("7.5.2.22", "1019h takes 0 and 2 to 240 only")
def counter_limits(dut: DeviceUnderTest) -> None:
    """Write 1 and 241."""
    dut.writable(_COUNTER_OVERFLOW)
    dut.expect_kept(_COUNTER_OVERFLOW, 0, (1, 241), *_VALUE)


@SYNC.check("7.5.2.22", "1019h cannot change while there is a cycle period")
def counter_while_running(dut: DeviceUnderTest) -> None:
    """Set 1006h, write 1019h: 0800 0022h."""
    dut.writable(_COUNTER_OVERFLOW)
    dut.writable(_CYCLE_PERIOD)
    with dut.setting(_CYCLE_PERIOD, 0, _PERIOD_US):
        dut.expect_abort(_COUNTER_OVERFLOW, 0, 10, _DEVICE_STATE)


@SYNC.check("7.5.2.6", "a SYNC producer has the period of 1006h")
def producer(dut: DeviceUnderTest) -> str:
    """Switch the producer on with 20 ms and take the median of 20 periods."""
    return judge_period([time for time, _ in _produced(dut, 0)], _PERIOD_US / 1000)


@SYNC.check("7.2.5.3.1", "the SYNC counter runs from 1 to 1019h")
def produced_counter(dut: DeviceUnderTest) -> None:
    """Produce SYNC with a counter up to 5."""
    dut.writable(_COUNTER_OVERFLOW)
    data = [data for _, data in _produced(dut, 5)]
    if any(len(one) != 1 or not 1 <= one[0] <= 5 for one in data):
        raise Deviation(f"SYNC data {_shown(data)}; one byte of 1 to 5 is right")
    if any(b[0] != a[0] % 5 + 1 for a, b in pairwise(data)):
        raise Deviation(f"SYNC counters {_shown(data)}; each one more, 1 after 5")


@SYNC.check("7.5.2.5", "the identifier cannot change while the device produces SYNC")
def identifier_of_producer(dut: DeviceUnderTest) -> str:
    """Write 1005h with another identifier: any abort is right."""
    before = _check_producer(dut)
    with dut.setting(_CYCLE_PERIOD, 0, 1_000_000), dut.setting(_COB_ID_SYNC, 0, before | _PRODUCER):
        return code_text(dut.expect_abort(_COB_ID_SYNC, 0, _PRODUCER | _OTHER))


@SYNC.check("7.5.2.15", "the identifier of TIME cannot change while it is consumed")
def time_identifier(dut: DeviceUnderTest) -> str:
    """Consume TIME by a free identifier, then write another: any abort is right."""
    before = int(dut.writable(_COB_ID_TIME).value)
    with dut.setting(_COB_ID_TIME, 0, before & ~_CONSUMER):
        dut.write(_COB_ID_TIME, 0, _OTHER)
        with dut.setting(_COB_ID_TIME, 0, _CONSUMER | _OTHER):
            return code_text(dut.expect_abort(_COB_ID_TIME, 0, _CONSUMER | (_OTHER + 1)))


@SYNC.check("7.2.6", "TIME messages of any length leave the device alive")
def time_messages(dut: DeviceUnderTest) -> None:
    """Send a sound one, a short one, an empty one and a remote frame."""
    can_id = dut.number(_COB_ID_TIME) & 0x7FF if _COB_ID_TIME in dut.objects else 0x100
    sound = bytes.fromhex("00286F02E83D")  # 11:20 on 1 May 2027: ms after midnight, days
    for frame in (
        Frame(can_id, sound),
        Frame(can_id, sound[:3]),
        Frame(can_id),
        Frame(can_id, is_remote=True),
    ):
        dut.wire.send(frame)
        dut.sdo.upload(0x1000)


def _produced(dut: DeviceUnderTest, overflow: int) -> list[tuple[float, bytes]]:
    """Return time and data of the SYNCs of the device as producer.

    Raises:
        Deviation: too few came.
    """
    before = _check_producer(dut)
    if overflow or _COUNTER_OVERFLOW in dut.objects:
        with dut.setting(_COUNTER_OVERFLOW, 0, overflow):
            arrivals = _listen(dut, before)
    else:
        arrivals = _listen(dut, before)
    if len(arrivals) < BEATS:
        raise Deviation(f"{len(arrivals)} SYNCs came in {BEATS / 10:g} s; one each 20 ms is right")
    return arrivals


def _listen(dut: DeviceUnderTest, cob_id: int) -> list[tuple[float, bytes]]:
    with (
        dut.setting(_CYCLE_PERIOD, 0, _PERIOD_US),
        dut.setting(_COB_ID_SYNC, 0, cob_id | _PRODUCER),
    ):
        dut.wire.wait(2e-6 * _PERIOD_US)
        dut.wire.forget()
        found = [dut.wire.take(_is_sync, BEATS / 10) for _ in range(BEATS + 1)]
    return [(arrival.time, arrival.frame.data) for arrival in found if arrival is not None]


def _check_producer(dut: DeviceUnderTest) -> int:
    """Return 1005h of a device that can produce SYNC.

    Raises:
        NotApplicable: it cannot, or somebody else does.
    """
    dut.writable(_CYCLE_PERIOD)
    dut.writable(_COB_ID_SYNC)
    dut.wire.forget()
    if dut.wire.take(_is_sync, dut.patience) is not None:
        raise NotApplicable("there is a SYNC producer on the bus already")
    before = dut.number(_COB_ID_SYNC)
    try:
        with dut.setting(_COB_ID_SYNC, 0, before | _PRODUCER):
            pass
    except Refused as refused:
        raise NotApplicable(f"the device produces no SYNC: {refused}") from None
    return before


def _is_sync(frame: Frame) -> bool:
    return is_data(frame, _SYNC)


def _shown(data: list[bytes]) -> str:
    return " ".join(one.hex() or "-" for one in data)
