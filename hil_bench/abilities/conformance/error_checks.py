"""Heartbeat and node guarding, both ways, and EMCY (CiA 301, 7.2.8.3.2 and 7.2.7).

Errors are provoked by a heartbeat that stays out: every device that watches heartbeats can have it.
"""

import contextlib
from collections.abc import Callable, Iterator

from hil_bench.abilities.conformance.check import (
    BEATS,
    TOLERANCE,
    Chapter,
    Impact,
    judge_period,
    median_period,
)
from hil_bench.abilities.conformance.device import HEARTBEAT_TIME, DeviceUnderTest
from hil_bench.abilities.conformance.verdicts import Deviation, NotApplicable
from hil_bench.abilities.conformance.wire import code_text
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.nmt import NmtCommand, NmtState

ERRORS = Chapter("Error control")
EMCY = Chapter("EMCY")

_CONSUMER = 0x1016
_HEARTBEAT_LOST = 0x8130
_WATCHED_MS = 500
"""Consumer heartbeat time [ms]; ten times our own period, for our host may be held up, too."""
_LOST_AFTER = 0.7
"""Time after which a heartbeat that is watched so has been missed [s]."""

_INCOMPATIBLE = 0x06040043
_ERROR_REGISTER, _HISTORY, _COB_ID, _INHIBIT_TIME = 0x1001, 0x1003, 0x1014, 0x1015
_GENERIC, _COMMUNICATION = 0x01, 0x10
_LONG_MS = 10_000
_LISTENING_MS = 5_000
"""Longest time for which the heartbeat is listened to, where nothing may be written [ms]."""
_HEARD_LATE_MS = 10
"""By how much the median period of a heartbeat may be off where it is short [ms]."""
_SILENCE = 1.1
"""Time in which no heartbeat comes that is off [s]; most devices have periods of up to 1 s."""
_ANOTHER = "does another node have this node-ID, too?"

_PERIOD_MS = 100
_PERIODS_MS = (_PERIOD_MS, 300)

_INVALID = 1 << 31
_INHIBITED = 0.2
_LATENESS = 0.05
"""By how much the first of two messages may have been late on its way [s]."""


@ERRORS.check("7.2.8.3.2.2", "a heartbeat is one byte, and names an NMT state", Impact.READ)
def heartbeat_format(dut: DeviceUnderTest) -> str:
    """Listen to some, and compare their period with 1017h; with 0 there is none.

    Another node with the same node-ID may have no SDO, and show by its heartbeat alone.
    """
    dut.variable(*HEARTBEAT_TIME)
    period = dut.number(*HEARTBEAT_TIME)
    dut.wire.forget()
    if period == 0:
        _expect_no_heartbeat(dut)
        raise NotApplicable("the heartbeat is off (1017h is 0)")
    count = min(BEATS, _LISTENING_MS // period) if period <= _LISTENING_MS // 2 else 0
    beats = []
    for _ in range(count + 1):
        arrival = dut.wire.take(dut.is_error_control, 2 * period / 1000 + dut.patience)
        if arrival is None:
            raise Deviation(f"no heartbeat, though 1017h is {period} ms")
        data = arrival.frame.data
        if len(data) != 1 or data[0] not in frozenset(NmtState):
            raise Deviation(f"heartbeat {data.hex(' ')}; one byte of 04, 05 or 7F is right")
        beats.append(arrival.time)
    if not count:
        return f"one came; 1017h is {period} ms, which was not measured"
    found = median_period(beats)
    if abs(found - period) > max(TOLERANCE * period, _HEARD_LATE_MS):
        doubt = f"; {_ANOTHER}" if found < period else ""
        raise Deviation(f"a heartbeat every {found:.1f} ms, though 1017h is {period} ms{doubt}")
    return f"every {found:.1f} ms"


def _expect_no_heartbeat(dut: DeviceUnderTest) -> None:
    """Judge that no heartbeat comes; what answers the remote frames of a master is none.

    Raises:
        Deviation: one came.
    """
    error_control = 0x700 + dut.node_id
    arrivals = dut.wire.take_all(
        lambda frame: frame.can_id == error_control and not frame.is_extended,
        max(dut.patience, _SILENCE),
    )
    frames = [arrival.frame for arrival in arrivals]
    beats = [each for each in frames if dut.is_error_control(each) and not dut.is_boot_up(each)]
    if beats and not any(frame.is_remote for frame in frames):
        raise Deviation(f"heartbeat {beats[0].data.hex(' ')}, though 1017h is 0; {_ANOTHER}")


@ERRORS.check("7.5.2.20", "the heartbeat has the period of 1017h")
def heartbeat_period(dut: DeviceUnderTest) -> str:
    """Set two periods, of which one needs both bytes of 1017h, and take the median of 20 each."""
    dut.writable(*HEARTBEAT_TIME)
    found = []
    for period in _PERIODS_MS:
        with dut.setting(*HEARTBEAT_TIME, period):
            dut.wire.wait(period / 1000)
            dut.wire.forget()
            beats = [dut.wire.take(dut.is_error_control, 1.0) for _ in range(BEATS + 1)]
        times = [beat.time for beat in beats if beat is not None]
        if len(times) != len(beats):
            raise Deviation(f"{len(times)} heartbeats in {BEATS + 1} s; one each {period} ms")
        found.append(judge_period(times, period))
    return ", ".join(found)


@ERRORS.check("7.5.2.20", "1017h = 0 ends the heartbeat")
def heartbeat_off(dut: DeviceUnderTest) -> None:
    """Switch it on and off, and listen."""
    dut.writable(*HEARTBEAT_TIME)
    with dut.setting(*HEARTBEAT_TIME, _PERIOD_MS):
        dut.write(*HEARTBEAT_TIME, 0)
        dut.wire.forget()
        if dut.wire.take_all(dut.is_error_control, 3 * _PERIOD_MS / 1000):
            raise Deviation("a heartbeat came after 1017h was set to 0")


@ERRORS.check("7.2.8.3.2.1", "node guarding is answered, the toggle bit alternates")
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


@ERRORS.check("7.2.8.3.2.2", "a heartbeat excludes node guarding")
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


@ERRORS.check("7.5.2.12", "life guarding that fails is an EMCY 8130h, and 0000h when it is over")
def life_guarding(dut: DeviceUnderTest) -> str:
    """Ask twice, fall silent for more than the life time, ask again."""
    dut.writable(0x100C)
    dut.writable(0x100D)
    _without_heartbeat(dut)
    with dut.setting(0x100C, 0, 50), dut.setting(0x100D, 0, 3):
        if dut.guard() is None:
            raise NotApplicable("node guarding is not answered")
        dut.wire.wait(0.15 + 0.1)
        dut.emergency(_HEARTBEAT_LOST, "150 ms without node guarding")
        dut.guard()
        return _error_end(dut, "node guarding came back", dut.guard)


@ERRORS.check("7.5.2.19", "a heartbeat that stays out is an EMCY 8130h")
def heartbeat_consumer(dut: DeviceUnderTest) -> None:
    """Send a heartbeat of a free node-ID that the device watches, and stop."""
    with _watching(dut) as producer:
        _beat(dut, producer)
        if dut.wire.take(dut.is_error, 0.001) is not None:
            raise Deviation("EMCY while the heartbeat came in time")
        dut.wire.wait(_LOST_AFTER)
        dut.emergency(_HEARTBEAT_LOST, f"{_WATCHED_MS} ms without a heartbeat")


@ERRORS.check("7.5.2.19", "nobody is watched before its first heartbeat")
def consumer_waits(dut: DeviceUnderTest) -> None:
    """Watch a node-ID that never sends."""
    with _watching(dut, _PERIOD_MS):
        arrival = dut.wire.take(dut.is_error, 5 * _PERIOD_MS / 1000)
        if arrival is not None:
            raise Deviation(f"EMCY {arrival.frame.data.hex(' ')} before the first heartbeat")


@ERRORS.check("7.5.2.19", "watching one node twice aborts with 0604 0043h")
def watched_twice(dut: DeviceUnderTest) -> None:
    """Give 1016h the same node-ID with two times."""
    producer = _watched_producer(dut)
    dut.writable(_CONSUMER, 2)
    with dut.setting(_CONSUMER, 1, producer << 16 | _WATCHED_MS):
        dut.expect_abort(_CONSUMER, 2, producer << 16 | 300, _INCOMPATIBLE)


@ERRORS.check("7.5.2.32", "after a communication error the node does as 1029h.01 says")
def error_behaviour(dut: DeviceUnderTest) -> str:
    """Lose a heartbeat in OPERATIONAL: PRE-OPERATIONAL by default, no change, STOPPED."""
    producer = _watched_producer(dut)
    choices = {0: NmtState.PRE_OPERATIONAL}
    if 0x1029 in dut.objects:
        dut.writable(0x1029, 1)
        choices |= {1: NmtState.OPERATIONAL, 2: NmtState.STOPPED}
    for choice, right in choices.items():
        dut.boot()
        if 0x1029 in dut.objects:
            dut.write(0x1029, 1, choice)
        dut.write(_CONSUMER, 1, producer << 16 | _WATCHED_MS)
        with dut.watched(), dut.operational():
            _beat(dut, producer)
            dut.wire.wait(_LOST_AFTER)
            dut.expect_state(right, f"a lost heartbeat with 1029h.01 = {choice}")
    dut.boot()
    return f"{len(choices)} choices"


def _error_end(dut: DeviceUnderTest, cause: str, go_on: Callable[[], object]) -> str:
    """Judge the end of a communication error: EMCY 0000h and 1001h say it, or neither.

    A device may keep an error until it is reset, and 1001h shows it as long.

    Args:
        dut: the device.
        cause: what ended the error.
        go_on: keeps it ended for a while.

    Raises:
        Deviation: the two do not agree.
    """
    deadline = dut.wire.now() + dut.patience
    while (arrival := dut.wire.take(lambda frame: dut.reports(frame, 0), dut.settling)) is None:
        if dut.wire.now() >= deadline:
            break
        go_on()
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


def _watched_producer(dut: DeviceUnderTest) -> int:
    """Return a free node-ID whose heartbeat the device can watch."""
    dut.writable(_CONSUMER, 1)
    dut.wire.forget()
    return dut.free_node_id


@contextlib.contextmanager
def _watching(dut: DeviceUnderTest, period_ms: int = _WATCHED_MS) -> Iterator[int]:
    """Have the device watch the heartbeat of a free node-ID.

    Yields:
        The node-ID.
    """
    producer = _watched_producer(dut)
    with dut.setting(_CONSUMER, 1, producer << 16 | period_ms):
        yield producer


def _beat(dut: DeviceUnderTest, producer: int) -> None:
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


# EMCY, error register and error history.


@EMCY.check("7.5.2.17", "1014h is 80h + node-ID by default", Impact.READ)
def identifier(dut: DeviceUnderTest) -> None:
    """Read 1014h."""
    dut.variable(_COB_ID)
    found = dut.number(_COB_ID)
    if found & 0x7FFFFFFF != 0x80 + dut.node_id:
        raise NotApplicable(f"configured to {found:08X}h")


@EMCY.check("7.5.2.4", "writing anything but 0 to 1003h.00 aborts with 0609 0030h")
def history_write(dut: DeviceUnderTest) -> None:
    """Write 1."""
    dut.writable(_HISTORY)
    dut.expect_abort(_HISTORY, 0, 1, 0x06090030, 0x06090031)


@EMCY.check("7.2.7.3.1", "EMCY has eight bytes, and the error register of 1001h")
def message(dut: DeviceUnderTest) -> str:
    """Lose a heartbeat; generic and communication bits are set in message and object."""
    with _lost_heartbeat(dut):
        data = dut.emergency(_HEARTBEAT_LOST, "a lost heartbeat")
        if len(data) != 8:
            raise Deviation(f"EMCY {data.hex(' ')}; 8 bytes are right")
        register = dut.number(_ERROR_REGISTER)
        if data[2] != register or not register & _GENERIC or not register & _COMMUNICATION:
            raise Deviation(
                f"error register {data[2]:02X}h in EMCY, {register:02X}h in 1001h; both alike with "
                "bits 0 and 4 is right"
            )
        return data.hex(" ").upper()


@EMCY.check("7.2.7.1", "when the error is gone, EMCY 0000h and the error register say so")
def error_reset(dut: DeviceUnderTest) -> str:
    """Lose a heartbeat and send it again."""
    with _lost_heartbeat(dut) as producer:
        dut.emergency(_HEARTBEAT_LOST, "a lost heartbeat")
        _beat(dut, producer)
        return _error_end(dut, "the heartbeat came back", lambda: _beat(dut, producer))


@EMCY.check("7.5.2.4", "1003h.01 is the latest error, and 0 to 1003h.00 empties the history")
def history(dut: DeviceUnderTest) -> None:
    """Lose a heartbeat, where nothing of worth is in the history."""
    dut.writable(_HISTORY)
    dut.boot()
    codes = {dut.number(_HISTORY, sub) & 0xFFFF for sub in range(1, dut.number(_HISTORY) + 1)}
    if codes - {_HEARTBEAT_LOST, 0x8210, 0x8220, 0x8250}:
        raise NotApplicable("the history holds errors that this suite did not cause")
    with _lost_heartbeat(dut):
        dut.emergency(_HEARTBEAT_LOST, "a lost heartbeat")
        latest = dut.number(_HISTORY, 1)
        if latest & 0xFFFF != _HEARTBEAT_LOST:
            raise Deviation(f"1003h.01 is {latest:08X}h; xxxx8130h is right")
        dut.write(_HISTORY, 0, 0)
        count = dut.number(_HISTORY)
        if count:
            raise Deviation(f"{count} errors in the history after it was emptied")


@EMCY.check("7.5.2.17", "bit 31 of 1014h switches EMCY off")
def switched_off(dut: DeviceUnderTest) -> None:
    """Lose a heartbeat with EMCY off."""
    dut.writable(_COB_ID)
    cob_id = dut.number(_COB_ID)
    with dut.setting(_COB_ID, 0, cob_id | _INVALID), _lost_heartbeat(dut):
        if dut.wire.take(dut.is_emergency, dut.patience) is not None:
            raise Deviation("EMCY came though 1014h has bit 31 set")


@EMCY.check("7.5.2.17", "the identifier of a valid EMCY cannot be changed")
def identifier_of_valid(dut: DeviceUnderTest) -> str:
    """Write another identifier: any abort is right."""
    dut.writable(_COB_ID)
    before = dut.number(_COB_ID)
    try:
        return code_text(dut.expect_abort(_COB_ID, 0, before ^ 0x100))
    finally:
        if dut.number(_COB_ID) != before:
            dut.write(_COB_ID, 0, before | _INVALID)
            dut.write(_COB_ID, 0, before)


@EMCY.check("7.5.2.18", "no two EMCYs within the inhibit time of 1015h")
def inhibit_time(dut: DeviceUnderTest) -> str:
    """Lose a heartbeat and send it again at once, with an inhibit time of 200 ms."""
    dut.writable(_INHIBIT_TIME)
    with dut.setting(_INHIBIT_TIME, 0, 2000), _watching(dut) as producer:
        _beat(dut, producer)
        dut.wire.forget()
        first = dut.wire.take(dut.is_emergency, _WATCHED_MS / 1000 + dut.patience)
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
    with _watching(dut) as producer:
        _beat(dut, producer)
        dut.wire.wait(_LOST_AFTER)
        yield producer
