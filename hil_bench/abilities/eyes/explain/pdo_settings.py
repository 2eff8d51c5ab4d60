"""Settings of PDOs that cannot work: timers, a SYNC that nobody sends, a mapping out of order."""

from collections.abc import Iterator
from typing import Final

from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.explain.finding import Cause, Finding, milliseconds
from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.abilities.eyes.pdos import Pdo, PdoField
from hil_bench.abilities.eyes.sight import Service, Sight
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.canopen_device.pdo_mapping import Direction
from hil_bench.canopen_device.pdo_parameters import EVENT_DRIVEN
from hil_bench.frame import address_of

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
