"""The cyclic messages of a bus, and their worst-case response times."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple

from hil_bench import frame as frames
from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.abilities.eyes.pdos import Pdo
from hil_bench.canopen_device.frame import BRS, FDF, Frame
from hil_bench.canopen_device.pdo_parameters import Direction
from hil_bench.canopen_device.sync import SYNC_COB_ID
from hil_bench.errors import ConfigError

if TYPE_CHECKING:
    from cantools.database.can import Message as DbcMessage


# The most bits of a frame.

_BEHIND: Final = 13
"""CRC delimiter, acknowledgement with its delimiter, end of frame, intermission."""


def worst_bits(length: int, *, is_extended: bool = False) -> int:
    """Return the bits of a data frame with the most stuff bits, and of the intermission after it.

    Of the bits that are stuffed, at most one follows each four but the first (Davis, Burns, Bril
    and Lukkien 2007, equation 1).

    Args:
        length: data bytes.
        is_extended: whether the identifier has 29 bits.
    """
    stuffed = (54 if is_extended else 34) + 8 * length
    return stuffed + _BEHIND + (stuffed - 1) // 4


def worst_fd_bits(length: int, *, is_extended: bool = False) -> tuple[int, int]:
    """Return the most bits of a frame with BRS: those at the bit rate, and those at the data one.

    Of the bits up to BRS, those behind the last of fixed value have none, so 14 (33 with a 29-bit
    identifier) are stuffed, and then those from BRS on but the last.

    Args:
        length: data bytes.
        is_extended: whether the identifier has 29 bits.
    """
    head = frames.FD_HEAD + frames.FD_EXTENSION * is_extended
    slow = head + (head - 4) // 4 + frames.ACK_TO_NEXT
    data = frames.FD_DLC + 8 * length
    return slow, data + (data - 1) // 4 + frames.fd_crc_bits(length)


# Worst-case response times of the messages on a CAN bus.
#
# Davis, Burns, Bril, Lukkien: Controller Area Network (CAN) schedulability analysis: Refuted,
# revisited and revised. Real-Time Systems 35 (2007) 239-272. All instances of the busy period are
# looked at, as the paper's correction of the older analysis asks.

_MOST_INSTANCES: Final = 10_000


class Message(NamedTuple):
    """A periodic or sporadic message; times in one unit of the caller's, such as ns.

    Attributes:
        name: for people.
        priority: the lower, the earlier; no two have the same.
        period: shortest time between two.
        transmission: longest time on the bus, with the intermission.
        jitter: how late it may be queued after its release.
    """

    name: str
    priority: int
    period: int
    transmission: int
    jitter: int = 0


def utilisation(messages: Sequence[Message]) -> float:
    """Return the share of the bus's time that the messages take at most."""
    return sum(message.transmission / message.period for message in messages)


def response_times(
    messages: Sequence[Message], *, bit_time: int, blocking: int = 0
) -> dict[str, int | None]:
    """Return the worst response time of each message, from its release to the bus being free again.

    Args:
        messages: all that are analysed.
        bit_time: of the bus.
        blocking: longest transmission of a message of the lowest priority that is not among them.

    Returns:
        By name; None where the messages of that priority and above overload the bus.
    """
    ordered = sorted(messages, key=lambda message: message.priority)
    found: dict[str, int | None] = {}
    for place, message in enumerate(ordered):
        lower = [other.transmission for other in ordered[place + 1 :]]
        block = max((blocking, *lower))
        found[message.name] = _response_time(message, ordered[:place], block, bit_time)
    return found


def _response_time(
    message: Message, higher: Sequence[Message], blocking: int, bit_time: int
) -> int | None:
    if utilisation((message, *higher)) >= 1.0:
        return None
    busy = _busy_period(message, higher, blocking)
    instances = _ceil(busy + message.jitter, message.period)
    if instances > _MOST_INSTANCES:
        return None
    worst, wait = 0, blocking
    for instance in range(instances):
        wait = _queueing(instance, wait, message, higher, (blocking, bit_time))
        response = message.jitter + wait - instance * message.period + message.transmission
        worst = max(worst, response)
        wait += message.transmission
    return worst


def _busy_period(message: Message, higher: Sequence[Message], blocking: int) -> int:
    """Return the longest time for which the bus is busy with this priority and above (eq. 8)."""
    length, before = message.transmission, -1
    while length != before:
        before = length
        length = blocking + sum(
            _ceil(before + other.jitter, other.period) * other.transmission
            for other in (*higher, message)
        )
    return length


def _queueing(
    instance: int,
    start: int,
    message: Message,
    higher: Sequence[Message],
    times: tuple[int, int],
) -> int:
    """Return the queueing delay of an instance from the start of the busy period (eq. 9)."""
    blocking, bit_time = times
    wait, before = start, -1
    while wait != before:
        before = wait
        wait = blocking + instance * message.transmission
        wait += sum(
            _ceil(before + other.jitter + bit_time, other.period) * other.transmission
            for other in higher
        )
    return wait


def _ceil(value: int, divisor: int) -> int:
    return -(-value // divisor)


# The cyclic messages of a bus: PDOs, SYNC and heartbeats of nodes, and the messages of a DBC.

_NS_PER_S: Final = 1_000_000_000
_NS_PER_MS: Final = 1_000_000
_INHIBIT_UNIT: Final = 100_000
_CYCLIC: Final = range(1, 241)
_HEARTBEAT_ID: Final = 0x700

SDO_BLOCKING: Final = worst_bits(8)
"""Bits of an SDO frame, which has a lower priority than all PDOs and may be on the bus already."""


class Assumptions(NamedTuple):
    """The assumptions that complete the objects of the nodes.

    Attributes:
        bitrate: of the bus [bit/s].
        cycle: of the controller: between two SYNCs, and two RPDOs [ns].
        jitter: how late a frame may be queued [ns].
        data_bitrate: of the data phase of CAN FD [bit/s]; 0 for a classical bus.
    """

    bitrate: int
    cycle: int
    jitter: int = 0
    data_bitrate: int = 0


class Stream(NamedTuple):
    """A cyclic message.

    Attributes:
        message: for the analysis.
        frame: one with zeros, which have the most stuff bits.
        why: where its period comes from.
    """

    message: Message
    frame: Frame
    why: str


def find_streams(nodes: Iterable[KnownNode], given: Assumptions) -> list[Stream]:
    """Return the cyclic messages on the bus of some nodes, the highest priority first.

    A message that several nodes receive counts once.
    """
    found: dict[int, Stream] = {}
    for node in nodes:
        for stream in (*_pdo_streams(node, given), *_heartbeat(node, given)):
            known = found.get(stream.frame.can_id)
            if known is None or stream.message.period < known.message.period:
                found[stream.frame.can_id] = stream
    if any("SYNC" in stream.why for stream in found.values()):
        found[SYNC_COB_ID] = _stream("SYNC", SYNC_COB_ID, 0, (given.cycle, "cycle"), given)
    return [found[can_id] for can_id in sorted(found)]


def dbc_streams(messages: Iterable["DbcMessage"], given: Assumptions) -> Iterator[Stream]:
    """Yield the messages of a DBC that have a cycle time.

    Raises:
        ConfigError: one is of CAN FD, and the bus is not.
    """
    for each in messages:
        if not each.cycle_time:
            continue
        if each.is_fd and not given.data_bitrate:
            wrong = f"{each.name} is of CAN FD, and the bus is classical"
            raise ConfigError(f"--dbc: {wrong}; give fd = true in [bus], or --fd")
        lengths = frames.FD_LENGTHS if each.is_fd else range(9)
        length = next((n for n in lengths if n >= each.length), None)
        if length is None:
            wrong = f"{each.name} has {each.length} bytes, at most {lengths[-1]} are right"
            raise ConfigError(f"--dbc: {wrong}; correct the file")
        fd = (FDF | BRS) if each.is_fd else 0
        frame = Frame(each.frame_id, bytes(length), is_extended=each.is_extended_frame, fd=fd)
        period = round(each.cycle_time * _NS_PER_MS)
        yield _stream_of(each.name, frame, (period, "DBC"), given)


def longest_foreign(given: Assumptions) -> int:
    """Return the longest time of a frame that is not analysed and may be on the bus already [ns].

    It is of SDO, and on a bus of CAN FD one of 64 bytes with BRS.
    """
    frame = Frame(0, bytes(64), is_extended=True, fd=FDF | BRS)
    longest = SDO_BLOCKING * (_NS_PER_S // given.bitrate)
    return max(longest, _longest(frame, given)) if given.data_bitrate else longest


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
    return _stream_of(name, Frame(can_id, bytes(length)), period, given)


def _stream_of(name: str, frame: Frame, period: tuple[int, str], given: Assumptions) -> Stream:
    message = Message(name, frames.priority(frame), period[0], _longest(frame, given), given.jitter)
    return Stream(message, frame, period[1])


def _longest(frame: Frame, given: Assumptions) -> int:
    """Return the longest time of a frame with so many bytes [ns]."""
    length, is_extended = len(frame.data), frame.is_extended
    if not frame.fd:
        return worst_bits(length, is_extended=is_extended) * _NS_PER_S // given.bitrate
    slow, fast = worst_fd_bits(length, is_extended=is_extended)
    return -(-slow * _NS_PER_S // given.bitrate) - (-fast * _NS_PER_S // given.data_bitrate)


# What a simulation of the bus shows.


@dataclass(slots=True)
class MeasuredTraffic:
    """The measured traffic of a simulated bus.

    Attributes:
        worst: longest time from a frame's release to the bus being free again [ns], by identifier.
        counts: frames by identifier.
        busy: time that frames were on the bus [ns].
        waiting: frames that had not been sent at the end.
    """

    worst: dict[int, int] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=dict)
    busy: int = 0
    waiting: int = 0
