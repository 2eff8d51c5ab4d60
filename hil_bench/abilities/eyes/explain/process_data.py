"""PDOs: lengths, mappings, identifiers, those that stay out, and those that nobody sends."""

from collections import deque
from collections.abc import Iterator

from hil_bench.abilities.common.identifiers import function_of
from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.explain.finding import (
    Cause,
    Evidence,
    Finding,
    finding,
    milliseconds,
    more,
    seconds,
)
from hil_bench.abilities.eyes.explain.pdo_courses import (
    Counters,
    Course,
    Gap,
    fell_silent,
    gap_of,
    settle,
    silence_finding,
)
from hil_bench.abilities.eyes.known_node import KnownNode, PdoOwner
from hil_bench.abilities.eyes.sight import Service, Sight
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.canopen_device.pdo_parameters import Direction
from hil_bench.frame import address_of

_KEPT = 16

_PATIENCE = 1_000_000_000
"""Time that a controller may take to its first set-point [ns]."""

_RPDO_EMCY = 0x8250
_LENGTH_EMCYS = frozenset({0x8210, 0x8220})
_CYCLIC = range(1, 241)
_HEARTBEAT_CONSUMERS = range(1, 128)

_Key = tuple[int, str]
"""Address of a PDO and name of its node."""


class ProcessData:
    """Watches the PDOs of all nodes.

    Args:
        decoder: that gives the sights.
    """

    hears = frozenset({Service.NMT, Service.EMCY, Service.PDO, Service.SYNC, Service.HEARTBEAT})

    def __init__(self, decoder: Decoder) -> None:
        self._decoder = decoder
        self._counters = Counters()
        self._lengths: dict[_Key, Evidence] = {}
        self._unknown: dict[_Key, Evidence] = {}
        self._courses: dict[_Key, Course] = {}
        self._running: dict[tuple[int, int], int] = {}
        self._emergencies: dict[str, deque[Sight]] = {}
        self._seen: dict[int, Sight] = {}
        self._now = 0
        self._pulses: set[tuple[int, int]] = set()

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        self._now = sight.now
        match sight.service:
            case Service.PDO if not sight.frame.is_remote:
                self._hear_pdo(sight)
            case Service.SYNC:
                self._hear_sync(sight)
            case Service.EMCY:
                self._emergencies.setdefault(sight.node, deque(maxlen=_KEPT)).append(sight)
            case Service.NMT:
                self._follow_states(list(self._decoder.nodes))
            case Service.HEARTBEAT if sight.node_id is not None:
                self._pulses.add((sight.frame.bus, sight.node_id))
                self._follow_states([(sight.frame.bus, sight.node_id)])

    def pause(self, length: int) -> None:
        """Count from the end of a pause."""
        for course in self._courses.values():
            if course.last >= 0:
                course.last += length

    def findings(self, end: int) -> Iterator[Finding]:
        """Yield what is wrong with the PDOs.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """
        yield from self._length_findings()
        yield from self._mapping_findings()
        yield from self._clash_findings()
        yield from self._counters.findings()
        for (address, _), course in self._courses.items():
            gap, gaps = course.gap, course.gaps
            is_left = course.owner in self._decoder.pdos.get(address, [])
            if is_left and (last := gap_of(course, end, None)) is not None:
                gap, gaps = gap or last, gaps + 1
            if gap is not None:
                yield self._gap_finding(course.owner, gap, gaps)
            elif is_left and fell_silent(course, end):
                yield silence_finding(course)
        yield from self._absences(end)

    def _follow_states(self, keys: list[tuple[int, int]]) -> None:
        """Begin to expect PDOs of nodes that become OPERATIONAL, end it with that state."""
        for key in keys:
            node = self._decoder.nodes[key]
            is_running = node.state is NmtState.OPERATIONAL
            if is_running and key not in self._running:
                self._running[key] = self._now
                for owner in self._owners_of(node):
                    if owner.pdo.direction is Direction.TPDO:
                        self._courses[owner.address, node.name] = Course(owner, self._now)
            elif not is_running and self._running.pop(key, None) is not None:
                self._counters.forget(node)
                for place, course in list(self._courses.items()):
                    if course.owner.node is node:
                        self._end(place)

    def _end(self, place: _Key) -> None:
        """Expect a PDO no longer, and keep what was wrong with it."""
        course = self._courses[place]
        if course.gap is None:
            del self._courses[place]
        else:
            course.last = -1

    def _owners_of(self, node: KnownNode) -> list[PdoOwner]:
        return [
            owner
            for owners in self._decoder.pdos.values()
            for owner in owners
            if owner.node is node
        ]

    def _hear_pdo(self, sight: Sight) -> None:
        address = _address(sight)
        self._seen.setdefault(address, sight)
        owners = self._decoder.pdos.get(address, [])
        if not owners:
            if sight.problem:
                self._unknown.setdefault((address, sight.node), Evidence()).append(sight)
            return
        for owner in owners:
            problem = sight.problem if len(owners) == 1 else owner.pdo.problem(sight.frame.data)
            if problem:
                self._lengths.setdefault((address, owner.node.name), Evidence()).append(sight)
            self._take(owner, address, sight)

    def _take(self, owner: PdoOwner, address: int, sight: Sight) -> None:
        course = self._courses.get((address, owner.node.name))
        is_lost = self._counters.take(owner, sight)
        if course is not None and course.last >= 0:
            is_same = course.owner.pdo is owner.pdo  # or configured anew meanwhile
            gap = gap_of(course, sight.now, sight) if is_same and not is_lost else None
            if gap is not None:
                course.gap, course.gaps = course.gap or gap, course.gaps + 1
            settle(course, sight.now - course.last)
        elif course is None or owner.node.state is NmtState.OPERATIONAL:
            course = course or Course(owner, sight.now)
            self._courses[address, owner.node.name] = course
        course.owner, course.last, course.sight, course.syncs = owner, sight.now, sight, 0

    def _hear_sync(self, sight: Sight) -> None:
        for course in self._courses.values():
            if course.owner.node.bus == sight.frame.bus:
                course.syncs += 1

    def _length_findings(self) -> Iterator[Finding]:
        for (address, node), sights in self._lengths.items():
            owner = next(
                owner
                for owner in self._decoder.pdos.get(_address(sights[0]), [])
                if owner.node.name == node
            )
            is_heard = owner.pdo.direction is Direction.RPDO
            if is_heard and any(
                each.pdo.direction is Direction.TPDO and (address, each.node.name) in self._lengths
                for each in self._decoder.pdos[address]
            ):
                continue  # its sender has another length than its own mapping
            reported = self._reported(node, _LENGTH_EMCYS)
            problem = sights[0].problem or owner.pdo.problem(sights[0].frame.data)
            text = f"{node} {owner.pdo.name}: {problem}"
            text += f", {sights.total} times" if sights.total > 1 else ""
            text += f"; {node} reports it by EMCY" if reported else ""
            shown = (*sights[:2], *reported[:1])
            is_sealed = owner.pdo.is_sealed(sights[0].frame.data)
            cause = Cause.PDO_CHECKSUM if is_sealed else Cause.PDO_LENGTH
            yield Finding(cause, node, sights[0].now, text, shown, sights.total)

    def _mapping_findings(self) -> Iterator[Finding]:
        for (_, node), sights in self._unknown.items():
            text = f"{node} {sights[0].name}: identifier 0x{sights[0].frame.can_id:03X} is on the "
            text += "bus, and by its EDS and its configuration the PDO does not exist"
            yield finding(Cause.MAPPING, node, sights, text)
        for course in self._courses.values():
            owner, pdo = course.owner
            if not owner.has_eds or course.sight is None:
                continue
            wrong = [each.problem for each in pdo.fields if each.problem]
            wrong += [
                f"0x{each.reader.index:04X}.{each.reader.subindex:02X} is not in the EDS"
                for each in pdo.fields
                if not each.problem and each.reader.data_type is None
            ]
            if wrong:
                text = f"{owner.name} {pdo.name}: {'; '.join(wrong)}"
                sight = course.sight
                yield Finding(Cause.MAPPING, owner.name, sight.now, text, (sight,))

    def _clash_findings(self) -> Iterator[Finding]:
        for address, owners in self._decoder.pdos.items():
            senders = [o for o in owners if o.pdo.direction is Direction.TPDO]
            sight = self._seen.get(address)
            if len(senders) > 1 and sight is not None:
                names = " and ".join(f"{o.node.name} {o.pdo.name}" for o in senders)
                text = f"{names} are both sent as 0x{senders[0].pdo.can_id:03X}"
                own = function_of(senders[0].pdo.can_id).node_id
                strange = [each for each in senders if each.node.node_id != own]
                node = (strange or senders)[-1].node.name
                yield Finding(Cause.IDENTIFIER_CLASH, node, sight.now, text, (sight,))

    def _gap_finding(self, owner: PdoOwner, gap: Gap, gaps: int) -> Finding:
        (node, pdo), (begin, end, sight) = owner, gap
        is_rpdo = pdo.direction is Direction.RPDO
        what = (
            f"{node.name} {pdo.name}: none for {milliseconds(end - begin)} after {seconds(begin)}"
        )
        if pdo.transmission_type in _CYCLIC and not is_rpdo:
            what += f", though it is due every {pdo.transmission_type} SYNC"
        else:
            meaning = "time-out" if is_rpdo else "event timer"
            what += f"; its {meaning} is {pdo.event_time_ms} ms"
        what += more(gaps)
        reported = self._reported(node.name, frozenset({_RPDO_EMCY})) if is_rpdo else []
        what += (
            f"; {node.name} reports it by EMCY at {seconds(reported[0].now)}" if reported else ""
        )
        shown = tuple(each for each in (*reported[:1], sight) if each is not None)
        cause = Cause.RPDO_TIMEOUT if is_rpdo else Cause.PDO_MISSING
        others = self._senders(owner) if is_rpdo else ()
        return Finding(cause, node.name, begin, what, shown, gaps, others)

    def _senders(self, owner: PdoOwner) -> tuple[str, ...]:
        """Return the names of the nodes that send an RPDO."""
        whose = function_of(owner.pdo.can_id).node_id
        names = [
            other.node.name
            for other in self._decoder.pdos.get(owner.address, [])
            if other.pdo.direction is Direction.TPDO
        ]
        if whose and whose != owner.node.node_id:
            names.append(self._name(owner.node.bus, whose))
        return tuple(names)

    def _name(self, bus: int, node_id: int) -> str:
        node = self._decoder.nodes.get((bus, node_id))
        return f"node {node_id}" if node is None else node.name

    def _absences(self, end: int) -> Iterator[Finding]:
        for key, begin in self._running.items():
            node = self._decoder.nodes[key]
            for owner in self._owners_of(node):
                if owner.pdo.direction is Direction.RPDO and self._waits(owner, end - begin):
                    whose = function_of(owner.pdo.can_id)
                    sender = f", of node {whose.node_id}" if whose.node_id else ""
                    text = f"{node.name} {owner.pdo.name}: nobody sends 0x{owner.pdo.can_id:03X}"
                    others = self._senders(owner)
                    yield Finding(
                        Cause.ABSENT_PRODUCER, node.name, begin, text + sender, others=others
                    )
            for producer, time in _consumed(node):
                if (node.bus, producer) not in self._pulses:
                    text = f"{node.name} waits for the heartbeat of node {producer} (0x1016, "
                    text += f"{time} ms), which never comes, so it watches nobody"
                    others = (self._name(node.bus, producer),)
                    yield Finding(Cause.ABSENT_PRODUCER, node.name, begin, text, others=others)

    def _waits(self, owner: PdoOwner, duration: int) -> bool:
        """Return True if an RPDO that was given a sender or a time-out has no sender.

        Args:
            owner: the RPDO.
            duration: since its node is OPERATIONAL [ns].
        """
        if owner.address in self._seen or not owner.pdo.fields:
            return False
        whose = function_of(owner.pdo.can_id)
        is_due = bool(owner.pdo.event_time_ms) and duration > _PATIENCE
        return is_due or whose.node_id != owner.node.node_id

    def _reported(self, node: str, codes: frozenset[int]) -> list[Sight]:
        return [sight for sight in self._emergencies.get(node, ()) if sight.emcy_code in codes]


def _address(sight: Sight) -> int:
    return address_of(sight.frame.can_id, sight.frame.bus)


def _consumed(node: KnownNode) -> Iterator[tuple[int, int]]:
    """Yield the heartbeats that a node watches: node-ID and time [ms] (0x1016)."""
    for subindex in _HEARTBEAT_CONSUMERS:
        if node.objects.find(0x1016, subindex) is None:
            return
        entry = node.number(0x1016, subindex)
        producer, time = entry >> 16 & 0xFF, entry & 0xFFFF
        if producer in _HEARTBEAT_CONSUMERS and time:
            yield producer, time
