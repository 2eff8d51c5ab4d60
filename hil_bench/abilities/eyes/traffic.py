"""The cyclic messages of nodes: their PDOs, SYNC and heartbeats, as their objects set them."""

from collections.abc import Iterable, Iterator
from typing import Final, NamedTuple

from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.abilities.eyes.pdos import Pdo
from hil_bench.abilities.eyes.response_times import Message
from hil_bench.canopen_device.pdo_mapping import Direction
from hil_bench.outside.bits import worst_bits

_NS_PER_S: Final = 1_000_000_000
_NS_PER_MS: Final = 1_000_000
_INHIBIT_UNIT: Final = 100_000
_CYCLIC: Final = range(1, 241)
_SYNC_ID: Final = 0x080
_HEARTBEAT_ID: Final = 0x700

SDO_BLOCKING: Final = worst_bits(8)
"""Bits of an SDO frame, which has a lower priority than all PDOs and may be on the bus already."""


class Assumptions(NamedTuple):
    """The assumptions that complete the objects of the nodes.

    Attributes:
        bitrate: of the bus [bit/s].
        cycle: of the controller: between two SYNCs, and two RPDOs [ns].
        jitter: how late a frame may be queued [ns].
    """

    bitrate: int
    cycle: int
    jitter: int = 0


class Stream(NamedTuple):
    """A cyclic message.

    Attributes:
        message: for the analysis.
        can_id: its identifier.
        length: data bytes.
        why: where its period comes from.
    """

    message: Message
    can_id: int
    length: int
    why: str


def find_streams(nodes: Iterable[KnownNode], given: Assumptions) -> list[Stream]:
    """Return the cyclic messages on the bus of some nodes, the highest priority first.

    A message that several nodes receive counts once.
    """
    found: dict[int, Stream] = {}
    for node in nodes:
        for stream in (*_pdo_streams(node, given), *_heartbeat(node, given)):
            known = found.get(stream.can_id)
            if known is None or stream.message.period < known.message.period:
                found[stream.can_id] = stream
    if any("SYNC" in stream.why for stream in found.values()):
        found[_SYNC_ID] = _stream("SYNC", _SYNC_ID, 0, (given.cycle, "cycle"), given)
    return [found[can_id] for can_id in sorted(found)]


def _pdo_streams(node: KnownNode, given: Assumptions) -> Iterator[Stream]:
    for pdo in node.pdos():
        if pdo.length:
            name = f"{node.name} {pdo.name}"
            yield _stream(name, pdo.can_id, pdo.length, _period(pdo, given.cycle), given)


def _period(pdo: Pdo, cycle: int) -> tuple[int, str]:
    """Return the shortest time between two [ns], and why it is that."""
    if pdo.transmission_type in _CYCLIC and pdo.direction is Direction.TPDO:
        return pdo.transmission_type * cycle, "SYNC"
    if pdo.direction is Direction.RPDO:
        return cycle, "cycle"
    if pdo.inhibit_time_100us:
        return pdo.inhibit_time_100us * _INHIBIT_UNIT, "inhibit time"
    if pdo.event_time_ms:
        return pdo.event_time_ms * _NS_PER_MS, "event timer"
    return cycle, "assumed"


def _heartbeat(node: KnownNode, given: Assumptions) -> Iterator[Stream]:
    period = node.number(0x1017) * _NS_PER_MS
    if period:
        name = f"{node.name} heartbeat"
        yield _stream(name, _HEARTBEAT_ID + node.node_id, 1, (period, "0x1017"), given)


def _stream(
    name: str, can_id: int, length: int, period: tuple[int, str], given: Assumptions
) -> Stream:
    transmission = worst_bits(length) * _NS_PER_S // given.bitrate
    message = Message(name, can_id, period[0], transmission, given.jitter)
    return Stream(message, can_id, length, period[1])
