"""Settings of PDOs, and transfers by SDO."""

from collections.abc import Iterator
from typing import Final

from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.explain.finding import (
    EVIDENCE,
    Cause,
    Evidence,
    Finding,
    finding,
    listed,
    milliseconds,
    more,
    seconds,
    together,
)
from hil_bench.abilities.eyes.frame_sights import transfer_title
from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.abilities.eyes.pdos import Pdo, PdoField
from hil_bench.abilities.eyes.sight import Service, Sight
from hil_bench.abilities.eyes.transfers import Transfer, Way
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.canopen_device.pdo_parameters import EVENT_DRIVEN, Direction
from hil_bench.frame import address_of

# Settings of PDOs that cannot work: timers, a SYNC that nobody sends, a mapping out of order.


_NS_PER_MS: Final = 1_000_000
_PATIENCE: Final = 1_000_000_000
_SYNCHRONOUS: Final = range(241)
_CONTROLWORD: Final = 0x6040
_COMMANDS: Final = frozenset({0x00, 0x02, 0x06, 0x07, 0x0F, 0x1F, 0x3F, 0x80})
"""Control words that masters of CiA 402 send: shutdown to enable operation, halt, fault reset."""

_FEWEST: Final = 5
_MOST: Final = 4096


class _Word:
    """The control word of an RPDO: how often it is one, and where else in the frame one is."""

    def __init__(self, pdo: Pdo, field: PdoField) -> None:
        self.pdo = pdo
        self.field = field
        self.frames = 0
        self.right = 0
        self.elsewhere: dict[int, int] = {}
        self.sight: Sight | None = None

    def hear(self, sight: Sight) -> None:
        """Take a frame that is not all zero."""
        word = int.from_bytes(sight.frame.data, "little")
        if not word:
            return
        self.sight = self.sight or sight
        self.frames += 1
        self.right += (word >> self.field.shift & 0xFFFF) in _COMMANDS
        for place in range(0, 8 * len(sight.frame.data) - 15, 8):
            if (word >> place & 0xFFFF) in _COMMANDS - {0}:
                self.elsewhere[place] = self.elsewhere.get(place, 0) + 1

    def place(self) -> int | None:
        """Return the first byte of what looks like the control word; None where it is in place."""
        if self.frames < _FEWEST or self.right * 2 > self.frames or not self.elsewhere:
            return None
        place, often = max(self.elsewhere.items(), key=lambda each: each[1])
        return place // 8 if often >= 0.9 * self.frames else None


class PdoSettings:
    """Holds the settings of PDOs against each other and against the bus.

    Args:
        decoder: that gives the sights.
    """

    hears = frozenset({Service.SYNC, Service.PDO, Service.NMT, Service.HEARTBEAT})

    def __init__(self, decoder: Decoder) -> None:
        self._decoder = decoder
        self._synced: set[int] = set()
        self._words: dict[tuple[int, str], _Word] = {}
        self._running: dict[tuple[int, int], int] = {}

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        bus = sight.frame.bus
        if sight.service is Service.SYNC:
            self._synced.add(bus)
        elif sight.service is Service.PDO:
            self._hear_pdo(sight)
        elif sight.service is Service.NMT:
            for key, node in self._decoder.nodes.items():
                self._follow(key, node, sight.now)
        elif sight.node_id is not None:
            key = bus, sight.node_id
            self._follow(key, self._decoder.nodes[key], sight.now)

    def pause(self, length: int) -> None:
        """Settings do not depend on the time."""

    def findings(self, end: int) -> Iterator[Finding]:
        """Yield the settings that cannot work.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """
        for key, node in self._decoder.nodes.items():
            since = self._running.get(key)
            if since is None:
                continue
            for pdo in node.pdos():
                if pdo.direction is Direction.TPDO:
                    yield from _timer_findings(node, pdo, since)
                    is_synced = node.bus in self._synced or end - since <= _PATIENCE
                    if pdo.transmission_type in _SYNCHRONOUS and pdo.fields and not is_synced:
                        text = f"{node.name} {pdo.name} waits for SYNC (transmission type "
                        text += f"{pdo.transmission_type}), which nobody sends"
                        yield Finding(Cause.ABSENT_PRODUCER, node.name, since, text)
        for (_, name), word in self._words.items():
            if (place := word.place()) is not None and word.sight is not None:
                text = f"{name} {word.pdo.name}: by its mapping the control word is at byte "
                text += f"{word.field.shift // 8}, where no command stands; byte {place} reads as "
                text += "one: the sender maps in another order"
                yield Finding(Cause.MAPPING, name, word.sight.now, text, (word.sight,))

    def _follow(self, key: tuple[int, int], node: KnownNode, now: int) -> None:
        if node.state is NmtState.OPERATIONAL:
            self._running.setdefault(key, now)
        else:
            self._running.pop(key, None)

    def _hear_pdo(self, sight: Sight) -> None:
        if sight.frame.is_remote or len(sight.frame.data) < 2:
            return
        address = address_of(sight.frame.can_id, sight.frame.bus)
        for owner in self._decoder.pdos.get(address, ()):
            if owner.pdo.direction is not Direction.RPDO:
                continue
            key = address, owner.node.name
            word = self._words.get(key)
            if word is None or word.pdo is not owner.pdo:
                fields = [f for f in owner.pdo.fields if f.reader.index == _CONTROLWORD]
                if not fields or len(self._words) >= _MOST:
                    continue
                word = self._words[key] = _Word(owner.pdo, fields[0])
            word.hear(sight)


def _timer_findings(node: KnownNode, pdo: Pdo, since: int) -> Iterator[Finding]:
    inhibit, event = pdo.inhibit_time_100us / 10, pdo.event_time_ms
    if pdo.transmission_type in EVENT_DRIVEN and event and inhibit > event:
        text = f"{node.name} {pdo.name}: its inhibit time is {milliseconds(inhibit * _NS_PER_MS)}, "
        text += f"its event timer {event} ms: it comes as the former allows"
        yield Finding(Cause.PDO_TIMERS, node.name, since, text)


# SDO transfers that failed, and devices that say something else than their EDS.


_IDENTITY = frozenset({(0x1000, 0), (0x1018, 1), (0x1018, 2), (0x1018, 3)})
_MOST_TRANSFERS = 4096
_NOT_THERE = frozenset({0x0602_0000, 0x0609_0011})
"""Abort codes of an object or a sub-index that the device does not have."""

_OF_PROFILES = 0x2000
"""First object that CiA 301 does not describe: of it, nobody looks whether it is there."""

_CUT_OFF = 500_000_000
"""A request within this time before the end of the log may still be answered [ns]."""

_TIMED_OUT = 0x0504_0000
"""Abort code of a client that has waited in vain: its request was not answered."""

_Key = tuple[int, int]  # bus and node-ID: a name may come with the log
_Group = tuple[_Key, int, int, int | None]


class Transfers:
    """Watches how SDO transfers end.

    Args:
        decoder: that gives the sights.
    """

    hears = frozenset({Service.SDO})

    def __init__(self, decoder: Decoder) -> None:
        self._decoder = decoder
        self._aborted: dict[_Group, Evidence] = {}
        self._silent: dict[_Key, Evidence] = {}
        self._shared: dict[_Key, Evidence] = {}
        self._differing: dict[tuple[_Key, int, int], tuple[Sight, str]] = {}

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        transfer = sight.transfer
        if transfer is None:
            return
        key = sight.frame.bus, sight.node_id or 0
        if transfer.is_overtaken and transfer.is_answered:
            self._shared.setdefault(key, Evidence()).append(sight)
        is_given_up = transfer.abort == _TIMED_OUT and transfer.is_aborted_by_client
        if transfer.abort is not None and not is_given_up:
            if self._is_look(sight, transfer):
                return
            group = key, transfer.index, transfer.subindex, transfer.abort
            if group in self._aborted or len(self._aborted) < _MOST_TRANSFERS:
                self._aborted.setdefault(group, Evidence()).append(sight)
        elif not transfer.is_done:
            silent = self._silent.setdefault(key, Evidence())
            before = silent.latest.transfer if silent.latest else None
            if not is_given_up or before is None or before.begin != transfer.begin:
                silent.append(sight)
        elif difference := self._difference(sight, transfer):
            place = key, transfer.index, transfer.subindex
            self._differing.setdefault(place, (sight, difference))

    def pause(self, length: int) -> None:
        """A transfer that a pause interrupts is one that failed, and told so."""

    def findings(self, end: int) -> Iterator[Finding]:
        """Yield what failed, what failed alike together.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """
        differing: dict[_Key, list[tuple[Sight, str]]] = {}
        for (key, *_), each in self._differing.items():
            differing.setdefault(key, []).append(each)
        for key, found in differing.items():
            node = self._decoder.nodes[key].name
            text = f"{node}: " + "; ".join(difference for _, difference in found[:EVIDENCE])
            text += f"; so are {len(found) - EVIDENCE} more" if len(found) > EVIDENCE else ""
            sights = Evidence(sight for sight, _ in found)
            yield finding(Cause.OTHER_DEVICE, node, sights, text)
        for key, sights in self._shared.items():
            node = self._decoder.nodes[key].name
            text = f"{node}: another request came before the answer to {sights[0].words}, "
            text += f"at {seconds(sights[0].now)}"
            text += more(sights.total, ", and")
            yield finding(Cause.SDO_SHARED, node, sights, text + ": two clients, or one in haste")
        yield from self._aborts()
        for key, sights in self._silent.items():
            node = self._decoder.nodes[key].name
            late = [s for s in sights if s.transfer and end - s.transfer.end > _CUT_OFF]
            if late:
                transfer = late[0].transfer
                begin = transfer.begin if transfer else late[0].now
                text = f"{node}: {late[0].words} is {late[0].problem}, at {seconds(begin)}"
                text += f"; so are {sights.total - 1} more" if sights.total > 1 else ""
                yield finding(Cause.SDO_NO_ANSWER, node, sights, text, begin)

    def _aborts(self) -> Iterator[Finding]:
        """Yield the aborted transfers, those of a node by one code together.

        Yields:
            The findings.
        """
        alike: dict[tuple[_Key, str], list[Evidence]] = {}
        for (key, *_), sights in self._aborted.items():
            way = sights[0].transfer.way if sights[0].transfer else ""
            alike.setdefault((key, f"{way} {sights[0].problem}"), []).append(sights)
        for (key, _), group in alike.items():
            yield self._abort(key, group)

    def _abort(self, key: _Key, group: list[Evidence]) -> Finding:
        """Return the finding of one or more objects whose transfers were aborted alike."""
        node = self._decoder.nodes[key].name
        first = group[0][0]
        places = [each[0].transfer.place for each in group[1:] if each[0].transfer is not None]
        sights = together(group)
        again = f", {sights.total} times" if sights.total > 1 else ""
        text = f"{node}: {listed([self._title(first), *places])} {first.problem}{again}"
        return finding(Cause.SDO_ABORT, node, sights, f"{text}, first at {seconds(first.now)}")

    def _is_look(self, sight: Sight, transfer: Transfer) -> bool:
        """Return True if somebody has merely looked whether a device has an object."""
        node = self._decoder.nodes.get((sight.frame.bus, sight.node_id or 0))
        is_absent = transfer.way is not Way.DOWNLOAD and transfer.abort in _NOT_THERE
        if not is_absent or node is None or transfer.index >= _OF_PROFILES:
            return False
        return not node.has_eds or node.objects.find(transfer.index, transfer.subindex) is None

    def _title(self, sight: Sight) -> str:
        node = self._decoder.nodes[sight.frame.bus, sight.node_id or 0]
        return "" if sight.transfer is None else transfer_title(node, sight.transfer)

    def _difference(self, sight: Sight, transfer: Transfer) -> str:
        """Return the difference of an answer from the EDS; empty where they agree."""
        node = self._decoder.nodes.get((sight.frame.bus, sight.node_id or 0))
        if node is None or not node.has_eds or transfer.way is not Way.UPLOAD:
            return ""
        if sight.problem:
            return f"{transfer.place} {sight.problem}"
        variable = node.objects.find(transfer.index, transfer.subindex)
        if variable is None:
            return f"has {transfer.place}, which its EDS does not have"
        is_identity = (transfer.index, transfer.subindex) in _IDENTITY
        told, right = int.from_bytes(transfer.data, "little"), variable.default
        if not is_identity or not right or told == right:
            return ""
        says = f"{transfer.place} {variable.name} is 0x{told:X}, 0x{right:X} in its EDS"
        return f"{says}: another device or revision"
