"""The course of one PDO: when it came, when it ought to have come, and when it did not."""

from dataclasses import dataclass

from hil_bench.abilities.eyes.explain.finding import Cause, Finding, milliseconds, seconds
from hil_bench.abilities.eyes.known_node import PdoOwner
from hil_bench.abilities.eyes.sight import Sight
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.canopen_device.pdo_mapping import Direction
from hil_bench.canopen_device.pdo_parameters import EVENT_DRIVEN

_NS_PER_MS = 1_000_000
_LATE = 3
"""Event times, or SYNCs it waits for, after which a TPDO counts as missing."""
_RPDO_SLACK = 1.05
_NS_PER_100_US = 100_000
_SETTLED = 20
"""Intervals alike after which a PDO has a period that nobody has set ..."""
_OUTLIER = 4
"""Intervals alike that one takes back which is not."""
_MANY = 10
"""... and such periods after which it has fallen silent."""
_PATIENCE = 1_000_000_000
"""Time that a controller may take to its first set-point [ns]."""
_CYCLIC = range(1, 241)

Gap = tuple[int, int, Sight | None]
"""Since when, until when [ns], and the frame that ended it."""


@dataclass(slots=True)
class Course:
    """When a PDO came, and the first time that it stayed out: since when, until when."""

    owner: PdoOwner
    last: int
    sight: Sight | None = None
    syncs: int = 0
    gap: Gap | None = None
    gaps: int = 0
    settled: int = 0
    """Intervals alike: the PDO comes with a period ..."""
    usual: int = 0
    """... of this [ns]."""


def gap_of(course: Course, now: int, sight: Sight | None) -> Gap | None:
    """Return the time in which a PDO was too late, or did not come; None for no such time."""
    owner, last = course.owner, course.last
    if last < 0 or owner.node.state is not NmtState.OPERATIONAL:
        return None
    pdo, gap = owner.pdo, now - last
    event_time = pdo.event_time_ms * _NS_PER_MS
    if pdo.direction is Direction.RPDO:
        is_late = event_time > 0 and gap > event_time * _RPDO_SLACK
    elif pdo.transmission_type in _CYCLIC:
        is_late = course.syncs > _LATE * pdo.transmission_type
    else:
        is_event = pdo.transmission_type in EVENT_DRIVEN
        due = max(event_time, pdo.inhibit_time_100us * _NS_PER_100_US)
        is_late = is_event and event_time > 0 and gap > _LATE * due
    return (last, now, sight) if is_late else None


def fell_silent(course: Course, end: int) -> bool:
    """Return True if a TPDO that nothing makes come had a period all the same, and stopped."""
    node, pdo = course.owner
    return (
        pdo.direction is Direction.TPDO
        and pdo.transmission_type in EVENT_DRIVEN
        and not pdo.event_time_ms
        and course.last >= 0
        and node.state is NmtState.OPERATIONAL
        and course.settled >= _SETTLED
        and end - course.last > max(_MANY * course.usual, _PATIENCE)
    )


def settle(course: Course, interval: int) -> None:
    """Follow whether a PDO comes with a period."""
    if 0.5 * course.usual <= interval <= 1.6 * course.usual:
        course.settled += 1
        course.usual += (interval - course.usual) // 8
    elif course.settled > _OUTLIER:  # one that was late ends no period
        course.settled -= _OUTLIER
    else:
        course.settled, course.usual = 0, interval


def silence_finding(course: Course) -> Finding:
    """Return that a TPDO without an event timer has fallen silent."""
    (node, pdo), last = course.owner, course.last
    text = f"{node.name} {pdo.name}: none after {seconds(last)}, though it came every "
    text += f"{milliseconds(course.usual)} before; its event timer is 0, so nothing makes it come"
    shown = () if course.sight is None else (course.sight,)
    return Finding(Cause.PDO_MISSING, node.name, last, text, shown)
