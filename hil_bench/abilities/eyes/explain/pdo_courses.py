"""Counters and courses in PDOs."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from hil_bench.abilities.eyes.explain.finding import (
    Cause,
    Evidence,
    Finding,
    finding,
    milliseconds,
    more,
    seconds,
)
from hil_bench.abilities.eyes.known_node import KnownNode, PdoOwner
from hil_bench.abilities.eyes.sight import Sight
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.canopen_device.pdo_parameters import EVENT_DRIVEN, SEAL_BYTES, Direction

# The course of one PDO: when it came, when it ought to have come, and when it did not.


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


# Counters of protected PDOs: frames that were lost, repeated or overtaken, and what stands.


_MODULUS: Final = 256
_BACK: Final = 128
"""Step of a counter from which it went back rather than on."""


@dataclass(slots=True)
class _Count:
    """The course of one PDO's counter."""

    owner: PdoOwner
    last: int | None = None
    spoilt: int = 0
    """Frames that were altered or repeated since the last that was neither."""
    sealed: int = 0
    unsealed: int = 0
    is_standing: bool = False
    standstills: int = 0
    stood_at: int = 0
    """Counter of the first frame that was repeated ..."""
    stood: int = 0
    """... and how often it was."""
    repeated: Evidence = field(default_factory=Evidence)
    first_jump: tuple[int, int, int] | None = None
    """Counters before and behind the first jump, and the frames that were lost there."""
    jumps: Evidence = field(default_factory=Evidence)
    lost: int = 0


class Counters:
    """Follows the counter of each protected PDO."""

    def __init__(self) -> None:
        self._counts: dict[tuple[int, str], _Count] = {}

    def take(self, owner: PdoOwner, sight: Sight) -> bool:
        """Follow a frame of a PDO.

        Args:
            owner: the PDO.
            sight: the frame.

        Returns:
            Whether its counter says that frames before it were sent, and did not arrive.
        """
        data = sight.frame.data
        place = owner.address, owner.node.name
        if not owner.pdo.is_sealed(data) or owner.pdo.problem(data):
            if (known := self._counts.get(place)) is not None:
                known.unsealed += 1
                known.spoilt += 1
            return False
        count = self._counts.setdefault(place, _Count(owner))
        count.owner, count.sealed = owner, count.sealed + 1
        counter, last = data[-SEAL_BYTES], count.last
        if counter == last:
            self._repeat(count, counter, sight)
            return False
        spoilt, count.last, count.spoilt, count.is_standing = count.spoilt, counter, 0, False
        step = 1 if last is None else (counter - last) % _MODULUS
        if last is None or step - 1 <= spoilt:
            return False
        lost = step - 1 - spoilt if step < _BACK else 0
        count.first_jump = count.first_jump or (last, counter, lost)
        count.jumps.append(sight)
        count.lost += lost
        return lost > 0

    def _repeat(self, count: _Count, counter: int, sight: Sight) -> None:
        if not count.is_standing:
            count.standstills += 1
        if count.standstills == 1:
            count.stood_at, count.stood = counter, count.stood + 1
        count.repeated.append(sight)
        count.is_standing = True
        count.spoilt += 1

    def forget(self, node: KnownNode) -> None:
        """Let the counters of a node begin anew, as after a reset."""
        for count in self._counts.values():
            if count.owner.node is node:
                count.last, count.spoilt, count.is_standing = None, 0, False

    def findings(self) -> Iterator[Finding]:
        """Yield the counters that did not go on by one.

        A PDO of which nobody says that it is protected counts as such if most of its frames have a
        right checksum.
        """
        for count in self._counts.values():
            if count.owner.pdo.is_protected or count.sealed > count.unsealed:
                if count.standstills:
                    yield _standstill_finding(count)
                if count.jumps:
                    yield _jump_finding(count)


def _standstill_finding(count: _Count) -> Finding:
    (node, pdo), since = count.owner, seconds(count.repeated[0].now)
    text = f"{node.name} {pdo.name}: counter stands at {count.stood_at} from {since} on, "
    text += f"{count.stood} frames repeated"
    if count.stood == 1:
        text = f"{node.name} {pdo.name}: frame with counter {count.stood_at} repeated at {since}"
    if count.standstills > 1:
        text += f"{more(count.standstills)}, {count.repeated.total} frames repeated in all"
    return finding(Cause.PDO_REPEATED, node.name, count.repeated, text)


def _jump_finding(count: _Count) -> Finding:
    (node, pdo), (before, after, lost) = count.owner, count.first_jump or (0, 0, 0)
    way = "" if lost else "back "
    text = f"{node.name} {pdo.name}: counter goes {way}from {before} to {after}"
    text += f" at {seconds(count.jumps[0].now)}"
    text += f", {lost} sent and not seen" if lost else ", overtaken or started anew"
    if count.jumps.total > 1:
        text += f"{more(count.jumps.total)}, {count.lost} not seen in all"
    return finding(Cause.PDO_LOST, node.name, count.jumps, text)
