"""The outcome of a transmission, known at its start: passed, or broken and by which station."""

from collections.abc import Callable, Iterable, Sequence
from enum import StrEnum
from typing import Final, NamedTuple

from hil_bench.abilities.copper.wire.bits import (
    ENDING,
    INTERMISSION,
    exact_bits,
    exact_fd_bits,
    fast_place,
    stuffed_bits,
)
from hil_bench.abilities.copper.wire.station import Rule, Station
from hil_bench.canopen_device.frame import BRS, ESI, Frame

# The end of a broken transmission: the stations that notice, and the time until the bus is free.
#
# ISO 11898-1: who notices an error sends six bits, dominant ones where it is error-active. These
# break the rule of stuffing, so that all others notice, and send six bits of their own. Eight
# recessive bits end it, and the intermission follows.

FLAG: Final = 6
"""Bits of an error flag."""

DELIMITER: Final = 8
"""Recessive bits after error flags."""

AFTER_FLAGS: Final = DELIMITER + INTERMISSION
"""Bits from the end of the error flags until the bus is free."""

ACK_SLOT: Final = 1
"""Place of the acknowledgement behind the CRC: the delimiter is before it."""


class ErrorKind(StrEnum):
    """The kind of an error on the bus."""

    BIT = "bit error"
    STUFF = "stuff error"
    ACK = "no acknowledge"
    DOMINANT = "stuck dominant"


class Broken(NamedTuple):
    """A transmission that failed.

    Attributes:
        kind: what was wrong.
        position: the disturbed bit, counted from the start of the frame, with stuff bits.
        length: bits from the start of the frame until the bus is free.
    """

    kind: ErrorKind
    position: int
    length: int


def disturbed(
    bits: Sequence[int], position: int, *, is_passive: bool, has_active_others: bool
) -> Broken:
    """Return the end of a transmission of which one bit is not on the bus as its sender meant it.

    Args:
        bits: those of the frame up to its CRC, with stuff bits.
        position: the bit that is wrong; it may be one of those behind the CRC.
        is_passive: whether the sender is error-passive.
        has_active_others: whether another station is error-active.
    """
    if position >= len(bits):  # a form error, which all see at once
        flags = FLAG
    else:
        level = 1 if is_passive else 0
        before = [*bits[:position], 1 - bits[position]]
        if _run(before, before[-1]) >= FLAG or not has_active_others:
            flags = FLAG
        else:
            flags = 2 * FLAG - _run(before, level)
    return Broken(ErrorKind.BIT, position, position + 1 + flags + AFTER_FLAGS)


def unacknowledged(bits: Sequence[int]) -> Broken:
    """Return the end of a transmission that nobody hears."""
    position = len(bits) + ACK_SLOT
    return Broken(ErrorKind.ACK, position, position + 1 + FLAG + AFTER_FLAGS)


def misread(bits: Sequence[int], position: int) -> Broken:
    """Return the end of a transmission that one error-active receiver alone takes for wrong.

    Its sender notices at the first recessive bit of its own, all others by the rule of stuffing.

    Args:
        bits: those of the frame up to its CRC, with stuff bits.
        position: the bit that the receiver takes for wrong.
    """
    position = min(position, len(bits) - 1)
    rest = [*bits[position + 1 :], 1]
    by_sender = rest.index(1) + 1 + FLAG
    by_others = 2 * FLAG - min(_run(bits[: position + 1], 0), FLAG)
    flags = max(by_sender, by_others)
    return Broken(ErrorKind.STUFF, position, position + 1 + flags + AFTER_FLAGS)


def length_on_bus(bits: Sequence[int]) -> int:
    """Return the bits in which a disturbance counts: all but the last of the end of frame."""
    return len(bits) + ENDING - 1


def _run(bits: Sequence[int], level: int) -> int:
    """Return the number of bits of a level at the end."""
    count = 0
    for bit in reversed(bits):
        if bit != level:
            break
        count += 1
    return count


Chance = Callable[[], int]
"""Draws how many bits pass until the next one that is disturbed."""


class Attempt(NamedTuple):
    """A transmission.

    Attributes:
        senders: who sends; more than one where they have the same identifier.
        frames: what each of them sends.
        length: bits until the bus is free.
        fast: those of them that have the data bit rate.
        broken: what is wrong; None where it passes.
        culprit: the receiver that breaks it.
        deaf: receivers that cannot read it.
    """

    senders: tuple[Station, ...]
    frames: tuple[Frame, ...]
    length: int
    fast: int = 0
    broken: Broken | None = None
    culprit: Station | None = None
    deaf: tuple[Station, ...] = ()


class Disturbances:
    """The disturbed bits of a bus.

    Args:
        chance: of disturbed bits; None for none.
    """

    def __init__(self, chance: Chance | None) -> None:
        self._chance = chance
        self._bits_left = chance() if chance else 0

    def attempt(
        self, senders: tuple[Station, ...], listeners: Sequence[Station], *, has_rules: bool
    ) -> Attempt:
        """Put the frames of some stations on the bus.

        Args:
            senders: those that won the arbitration.
            listeners: all stations that are not bus-off.
            has_rules: whether one of them has a rule by which it misreads frames.
        """
        frames = tuple(map(_begin, senders))
        is_sure = (
            len(senders) == 1
            and self._chance is None
            and not senders[0].send_rules
            and not has_rules
            and len(listeners) > 1
        )
        if is_sure:
            return _sound(senders, frames)
        return self._doubtful(senders, frames, listeners)

    def _doubtful(
        self,
        senders: tuple[Station, ...],
        frames: tuple[Frame, ...],
        listeners: Sequence[Station],
    ) -> Attempt:
        """Return the end of a transmission that may fail."""
        sent = sorted(
            zip(map(stuffed_bits, frames), range(len(senders)), strict=True)
        )  # dominant bits win
        senders = tuple(senders[place] for _, place in sent)
        frames = tuple(frames[place] for _, place in sent)
        bits, first, frame = sent[0][0], senders[0], frames[0]
        others = [each for each in listeners if each not in senders]
        has_active = any(not each.is_passive for each in others)
        broken = _clash([(own, each) for (own, _), each in zip(sent, senders, strict=True)])
        culprit, deaf = None, list[Station]()
        if broken is None and len(senders) == 1 and not others:
            broken = unacknowledged(bits)
        if broken is None and (position := self._position(first, frame, bits)) is not None:
            broken = disturbed(
                bits, position, is_passive=first.is_passive, has_active_others=has_active
            )
        for each in others if broken is None else ():
            share = _share(each.receive_rules, frame)
            if share is not None and each.is_passive:
                deaf.append(each)
            elif share is not None and broken is None:
                culprit, broken = each, misread(bits, int(share * len(bits)))
        if broken is None:
            return _sound(senders, frames)._replace(deaf=tuple(deaf))
        fast = 0
        if frame.fd & BRS:  # flags and what follows have the bit rate again
            most = exact_fd_bits(frame)[1]
            fast = min(max(broken.position + 1 - fast_place(frame), 0), most)
        return Attempt(senders, frames, broken.length, fast, broken, culprit, tuple(deaf))

    def _position(self, sender: Station, frame: Frame, bits: list[int]) -> int | None:
        """Return the position of the disturbed bit on the bus, None without a disturbance."""
        share = _share(sender.send_rules, frame)
        length = length_on_bus(bits)
        if share is not None:
            return int(share * length)
        if self._chance is None:
            return None
        if self._bits_left < length:
            position = self._bits_left
            self._bits_left = self._chance()
            return position
        self._bits_left -= length
        return None


def _begin(station: Station) -> Frame:
    """Have a station begin to send its head; one that is error-passive sets ESI in CAN FD."""
    frame = station.begin().frame
    return frame._replace(fd=frame.fd | ESI) if frame.fd and station.is_passive else frame


def _sound(senders: tuple[Station, ...], frames: tuple[Frame, ...]) -> Attempt:
    """Return a transmission that passes."""
    frame = frames[0]
    fast = exact_fd_bits(frame)[1] if frame.fd & BRS else 0
    return Attempt(senders, frames, exact_bits(frame), fast)


def _clash(sent: list[tuple[list[int], Station]]) -> Broken | None:
    """Return the break between different frames of one identifier, None without a conflict.

    Who sends a recessive bit and reads a dominant one notices. An error-passive one cannot break
    the other's frame, and falls out.

    Args:
        sent: the bits of each sender, those of the winner first.
    """
    winner = sent[0][0]
    for own, station in sent[1:]:
        if not station.is_passive:
            for place, (bit, other) in enumerate(zip(own, winner, strict=False)):
                if bit != other:
                    return disturbed(own, place, is_passive=False, has_active_others=True)
    return None


def _share(rules: Iterable[Rule], frame: Frame) -> float | None:
    for rule in rules:
        share = rule(frame)
        if share is not None:
            return share
    return None
