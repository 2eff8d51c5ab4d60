"""The outcome of a transmission, known at its start: passed, or broken and by which station."""

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from hil_bench.abilities.copper.wire.broken import (
    Broken,
    disturbed,
    length_on_bus,
    misread,
    unacknowledged,
)
from hil_bench.abilities.copper.wire.station import Rule, Station
from hil_bench.canopen_device.frame import BRS, ESI, Frame
from hil_bench.outside.bits import exact_bits, exact_fd_bits, fast_place, stuffed_bits

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
