"""Worst-case response times of the messages on a CAN bus.

Davis, Burns, Bril, Lukkien: Controller Area Network (CAN) schedulability analysis: Refuted,
revisited and revised. Real-Time Systems 35 (2007) 239-272. All instances of the busy period are
looked at, as the paper's correction of the older analysis asks.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

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
