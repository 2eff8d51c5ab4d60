"""Heartbeat and node guarding, both ways (CiA 301, 7.2.8.3.2)."""

from collections.abc import Callable
from itertools import pairwise
from statistics import median

from hil_bench.abilities.conformance.check import Chapter, Impact
from hil_bench.abilities.conformance.device import HEARTBEAT_TIME, DeviceUnderTest
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.nmt import NmtCommand, NmtState

CHAPTER = Chapter("Error control")

CONSUMER = 0x1016
HEARTBEAT_LOST = 0x8130
WATCHED_MS = 500
"""Consumer heartbeat time [ms]; ten times our own period, for our host may be held up, too."""
LOST_AFTER = 0.7
"""Time after which a heartbeat that is watched so has been missed [s]."""

_INCOMPATIBLE = 0x06040043
_ERROR_REGISTER, _COMMUNICATION = 0x1001, 0x10
_LONG_MS = 10_000
_PERIOD_MS = 100
_BEATS = 20
_TOLERANCE = 0.1
"""Share by which the median period may be off: an adapter and a host have their own delays."""


@CHAPTER.check("7.2.8.3.2.2", "a heartbeat is one byte, and names an NMT state")
def heartbeat_format(dut: DeviceUnderTest) -> str:
    """Listen, where 1017h says that there is a heartbeat."""
    dut.variable(*HEARTBEAT_TIME)
    period = dut.number(*HEARTBEAT_TIME)
    if period == 0:
        raise NotApplicable("the heartbeat is off (1017h is 0)")
    dut.wire.forget()
    arrival = dut.wire.take(dut.is_error_control, 2 * period / 1000 + dut.patience)
    if arrival is None:
        raise Deviation(f"no heartbeat, though 1017h is {period} ms")
    data = arrival.frame.data
    if len(data) != 1 or data[0] not in frozenset(NmtState):
        raise Deviation(f"heartbeat {data.hex(' ')}; one byte of 04, 05 or 7F is right")
    return f"every {period} ms"


@CHAPTER.check("7.5.2.20", "the heartbeat has the period of 1017h", Impact.WRITE)
def heartbeat_period(dut: DeviceUnderTest) -> str:
    """Set 100 ms and take the median of 20 periods."""
    dut.writable(*HEARTBEAT_TIME)
    with dut.setting(*HEARTBEAT_TIME, _PERIOD_MS):
        dut.wire.wait(_PERIOD_MS / 1000)
        dut.wire.forget()
        beats = [dut.wire.take(dut.is_error_control, 1.0) for _ in range(_BEATS + 1)]
    times = [beat.time for beat in beats if beat is not None]
    if len(times) != len(beats):
        raise Deviation(f"{len(times)} heartbeats in {_BEATS + 1} s; one each {_PERIOD_MS} ms")
    period_ms = median(b - a for a, b in pairwise(times)) * 1000
    if abs(period_ms - _PERIOD_MS) > _TOLERANCE * _PERIOD_MS:
        raise Deviation(f"period {period_ms:.1f} ms; {_PERIOD_MS} ms is right")
    return f"{period_ms:.1f} ms"


@CHAPTER.check("7.5.2.20", "1017h = 0 ends the heartbeat", Impact.WRITE)
def heartbeat_off(dut: DeviceUnderTest) -> None:
    """Switch it on and off, and listen."""
    dut.writable(*HEARTBEAT_TIME)
    with dut.setting(*HEARTBEAT_TIME, _PERIOD_MS):
        dut.write(*HEARTBEAT_TIME, 0)
        dut.wire.forget()
        if dut.wire.take_all(dut.is_error_control, 3 * _PERIOD_MS / 1000):
            raise Deviation("a heartbeat came after 1017h was set to 0")


@CHAPTER.check("7.2.8.3.2.1", "node guarding is answered, the toggle bit alternates", Impact.WRITE)
def guarding(dut: DeviceUnderTest) -> str:
    """Ask four times after a reset, with the heartbeat off; if in vain, again with a life time.

    Whether a device is guarded while 100Ch and 100Dh are 0, no clause says.
    """
    _without_heartbeat(dut)
    answers = [dut.guard() for _ in range(4)]
    detail = ""
    if answers == [None] * 4:
        if 0x100C not in dut.objects:
            raise NotApplicable("no answer, and no 100Ch in the EDS")
        dut.writable(0x100C)
        dut.writable(0x100D)
        with dut.setting(0x100C, 0, _LONG_MS), dut.setting(0x100D, 0, 3):
            answers = [dut.guard() for _ in range(4)]
        detail = "with 100Ch and 100Dh set"
    if answers == [None] * 4:
        raise Deviation("no answer to a remote frame, though the EDS has 100Ch")
    right = [b"\x7f", b"\xff", b"\x7f", b"\xff"]
    if answers != right:
        shown = " ".join("-" if answer is None else answer.hex() for answer in answers)
        raise Deviation(f"answers {shown}; 7f ff 7f ff is right")
    return detail


@CHAPTER.check("7.2.8.3.2.2", "a heartbeat excludes node guarding", Impact.WRITE)
def guarding_excluded(dut: DeviceUnderTest) -> None:
    """Ask by remote frames while the heartbeat is on, at a long period.

    A heartbeat may come by itself meanwhile, as the first one of the new period; not two.
    """
    dut.writable(*HEARTBEAT_TIME)
    with dut.setting(*HEARTBEAT_TIME, 10_000):
        dut.wire.wait(dut.settling)
        answers = [answer for answer in (dut.guard(), dut.guard(), dut.guard()) if answer]
        if len(answers) > 1:
            said = b"".join(answers).hex(" ")
            raise Deviation(f"answers {said} to remote frames; silence is right")


@CHAPTER.check(
    "7.5.2.12", "life guarding that fails is an EMCY 8130h, and 0000h when it is over", Impact.WRITE
)
def life_guarding(dut: DeviceUnderTest) -> str:
    """Ask twice, fall silent for more than the life time, ask again."""
    dut.writable(0x100C)
    dut.writable(0x100D)
    _without_heartbeat(dut)
    with dut.setting(0x100C, 0, 50), dut.setting(0x100D, 0, 3):
        if dut.guard() is None:
            raise NotApplicable("node guarding is not answered")
        dut.wire.wait(0.15 + 0.1)
        dut.emergency(HEARTBEAT_LOST, "150 ms without node guarding")
        dut.guard()
        return error_end(dut, "node guarding came back", dut.guard)


@CHAPTER.check("7.5.2.19", "a heartbeat that stays out is an EMCY 8130h", Impact.WRITE)
def heartbeat_consumer(dut: DeviceUnderTest) -> None:
    """Send a heartbeat of a free node-ID that the device watches, and stop."""
    producer = watched_producer(dut)
    with dut.setting(CONSUMER, 1, producer << 16 | WATCHED_MS):
        beat(dut, producer)
        if dut.wire.take(dut.is_error, 0.001) is not None:
            raise Deviation("EMCY while the heartbeat came in time")
        dut.wire.wait(LOST_AFTER)
        dut.emergency(HEARTBEAT_LOST, f"{WATCHED_MS} ms without a heartbeat")


@CHAPTER.check("7.5.2.19", "nobody is watched before its first heartbeat", Impact.WRITE)
def consumer_waits(dut: DeviceUnderTest) -> None:
    """Watch a node-ID that never sends."""
    producer = watched_producer(dut)
    with dut.setting(CONSUMER, 1, producer << 16 | _PERIOD_MS):
        arrival = dut.wire.take(dut.is_error, 5 * _PERIOD_MS / 1000)
        if arrival is not None:
            raise Deviation(f"EMCY {arrival.frame.data.hex(' ')} before the first heartbeat")


@CHAPTER.check("7.5.2.19", "watching one node twice aborts with 0604 0043h", Impact.WRITE)
def watched_twice(dut: DeviceUnderTest) -> None:
    """Give 1016h the same node-ID with two times."""
    producer = watched_producer(dut)
    dut.writable(CONSUMER, 2)
    with dut.setting(CONSUMER, 1, producer << 16 | WATCHED_MS):
        raw = (producer << 16 | 300).to_bytes(4, "little")
        request = b"\x23\x16\x10\x02" + raw
        dut.sdo.expect_abort(request, _INCOMPATIBLE)


@CHAPTER.check(
    "7.5.2.32", "after a communication error the node does as 1029h.01 says", Impact.WRITE
)
def error_behaviour(dut: DeviceUnderTest) -> str:
    """Lose a heartbeat in OPERATIONAL: PRE-OPERATIONAL by default, no change, STOPPED."""
    producer = watched_producer(dut)
    choices = {0: NmtState.PRE_OPERATIONAL}
    if 0x1029 in dut.objects:
        dut.writable(0x1029, 1)
        choices |= {1: NmtState.OPERATIONAL, 2: NmtState.STOPPED}
    for choice, right in choices.items():
        dut.boot()
        if 0x1029 in dut.objects:
            dut.write(0x1029, 1, choice)
        dut.write(CONSUMER, 1, producer << 16 | WATCHED_MS)
        with dut.watched(), dut.operational():
            beat(dut, producer)
            dut.wire.wait(LOST_AFTER)
            dut.expect_state(right, f"a lost heartbeat with 1029h.01 = {choice}")
    dut.boot()
    return f"{len(choices)} choices"


def error_end(dut: DeviceUnderTest, cause: str, go_on: Callable[[], object]) -> str:
    """Judge the end of a communication error: EMCY 0000h and 1001h say it, or neither.

    A device may keep an error until it is reset, and 1001h shows it as long.

    Args:
        dut: the device.
        cause: what ended the error.
        go_on: keeps it ended for a while.

    Raises:
        Deviation: the two do not agree.
    """

    def is_end(frame: Frame) -> bool:
        return dut.is_emergency(frame) and frame.data[:2] == b"\0\0"

    deadline = dut.wire.now() + dut.patience
    arrival = dut.wire.take(is_end, dut.settling)
    while arrival is None and dut.wire.now() < deadline:
        go_on()
        arrival = dut.wire.take(is_end, dut.settling)
    register = dut.number(_ERROR_REGISTER)
    is_over = not register & _COMMUNICATION
    if arrival is None:
        if is_over:
            raise Deviation(
                f"no EMCY 0000h within {dut.patience:g} s after {cause}, though 1001h is "
                f"{register:02X}h"
            )
        return f"the device keeps the error, 1001h is {register:02X}h"
    if arrival.frame.data[2:3] != bytes([register]) or not is_over:
        said = arrival.frame.data[2:3].hex().upper()
        raise Deviation(f"error register {said}h in EMCY 0000h, {register:02X}h in 1001h")
    return ""


def watched_producer(dut: DeviceUnderTest) -> int:
    """Return a free node-ID whose heartbeat the device can watch."""
    dut.writable(CONSUMER, 1)
    dut.wire.forget()
    return dut.free_node_id


def beat(dut: DeviceUnderTest, producer: int) -> None:
    """Send a heartbeat six times, every 50 ms."""
    for _ in range(6):
        dut.wire.send(Frame(0x700 + producer, bytes([NmtState.OPERATIONAL])))
        dut.wire.wait(0.05)


def _without_heartbeat(dut: DeviceUnderTest) -> None:
    dut.boot()
    dut.command(NmtCommand.ENTER_PRE_OPERATIONAL)
    variable = dut.objects.find(*HEARTBEAT_TIME)
    if variable is not None and dut.number(*HEARTBEAT_TIME):
        dut.writable(*HEARTBEAT_TIME)
        dut.write(*HEARTBEAT_TIME, 0)
        dut.wire.wait(dut.settling)
