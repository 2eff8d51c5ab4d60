"""Address claims on J1939: clashes of addresses and NAMEs, and devices that restart."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from hil_bench.abilities.eyes.explain.finding import (
    Cause,
    Evidence,
    Finding,
    finding,
    milliseconds,
    seconds,
)
from hil_bench.abilities.eyes.explain.j1939 import (
    VIOLATION_FMI,
    VIOLATION_SPN,
    OfJ1939,
    Who,
)
from hil_bench.abilities.eyes.j1939 import trouble_codes
from hil_bench.abilities.eyes.sight import J1939Message, Sight
from hil_bench.abilities.j1939.protocol import signals

_MS: Final = 1_000_000
_SETTLED: Final = 1250 * _MS
"""Time after which a device that has lost its address has said what it does [ns]."""

_INSISTS: Final = 2
"""Times that a device of the greater NAME may claim an address which it has lost, by restarts."""

_AGAIN: Final = 3
"""Claims in a row that nobody has asked for, of a device that restarts before it says anything."""

_MOVED: Final = 300 * _MS
"""Time after which a device that claims another address sends from the one before no more [ns]."""

_STAYS: Final = 2
"""Frames from an address that its device has left, after that time."""

_DARK: Final = 250 * _MS
_LONGER: Final = 1.5
"""Silence before a claim that nobody has asked for, of a device that restarts: at least so long
[ns], and so many times the usual time between two frames of the device."""

_AT_ONCE: Final = 750 * _MS
"""Time within which all answer who were asked for their claims [ns]: 250 ms, and up to 153 ms by
chance for those that begin to claim then, with as much again for a busy bus."""

_ALL: Final = 3
"""Devices that claim at once on a bus that goes on: somebody has asked whom the log does not show,
as an adapter that does not record what it sends itself."""

_FEWEST: Final = 3
_MOST: Final = 4096

_Device = tuple[int, bytes]
"""Bus and NAME."""


class Addresses(OfJ1939):
    """Watches who claims which address, and who has none."""

    def __init__(self) -> None:
        self._owners: dict[Who, tuple[bytes, Sight]] = {}
        self._without: dict[_Device, tuple[str, Sight]] = {}
        self._contended: dict[_Device, tuple[Sight, Sight]] = {}
        self._insists: dict[tuple[Who, bytes], Evidence] = {}
        self._places: dict[_Device, int] = {}
        self._kept: dict[_Device, tuple[Sight, Sight]] = {}
        self._in_use: dict[Who, None] = {}
        self._newcomers: dict[int, Sight] = {}
        self._violations: dict[Who, Evidence] = {}

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        message = sight.message
        if message is None or message.data is None:
            return
        bus = sight.frame.bus
        if message.group == signals.ADDRESS_CLAIMED and len(message.data) == signals.NAME_BYTES:
            self._hear_claim(bus, message.source, message.data, sight)
            return
        if len(self._in_use) < _MOST:
            self._in_use[bus, message.source] = None
        if message.group == signals.DM1:
            for spn, fmi in trouble_codes(message.data):
                if fmi == VIOLATION_FMI and spn - VIOLATION_SPN == message.source:
                    self._violations.setdefault((bus, message.source), Evidence()).append(sight)

    def _hear_claim(self, bus: int, address: int, name: bytes, sight: Sight) -> None:
        if len(self._places) < _MOST:
            self._places[bus, name] = address
        if address == signals.NULL:  # without a contender it merely signs off
            contention = self._contended.pop((bus, name), None)
            newcomer = self._newcomers.get(bus)
            if contention is not None:
                self._without.setdefault((bus, name), (contention[1].node, sight))
            elif newcomer is not None and _is_recent(newcomer.now, sight):
                self._without.setdefault((bus, name), (newcomer.node, sight))
            return
        self._without.pop((bus, name), None)
        self._contended.pop((bus, name), None)
        owner = self._owners.get((bus, address))
        if owner is None and (bus, address) in self._in_use:
            self._newcomers[bus] = sight  # somebody has it whose claim was before the log
        if owner is not None and owner[0] != name:
            self._contest((bus, address), name, sight, *owner)
        if len(self._owners) < _MOST:
            self._owners[bus, address] = name, sight

    def _contest(self, who: Who, name: bytes, sight: Sight, owner: bytes, claim: Sight) -> None:
        """Take a claim of an address that another one has claimed."""
        bus, address = who
        loser = max(owner, name, key=lambda each: int.from_bytes(each, "little"))
        self._contended[bus, loser] = claim, sight
        if loser != name:  # the other one may have to defend it
            self._kept.pop((bus, loser), None)
            return
        if len(self._insists) < _MOST:
            self._insists.setdefault((who, name), Evidence()).append(sight)
        is_there = self._places.get((bus, owner)) == address
        is_asked = sight.message is not None and sight.message.is_answer  # so it is no restart
        if is_there and is_asked and len(self._kept) < _MOST:
            self._kept.setdefault((bus, name), (claim, sight))

    def findings(self, end: int) -> Iterator[Finding]:
        """Yield the devices without an address, and the addresses of two.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """
        insisting = {name for (_, name), said in self._insists.items() if said.total > _INSISTS}
        for (_, name), said in self._insists.items():
            if said.total > _INSISTS:
                first = said[0]
                text = f"two claim {first.node} in turns from {seconds(first.now)} on: NAME"
                text += f" {_name(name)} has to yield, and claims it {said.total} times"
                yield finding(Cause.ADDRESS_CLASH, first.node, said, text)
        for (_, name), (first, second) in self._kept.items():
            if name not in insisting and first.message is not None:
                text = (
                    f"the NAME at {second.node} changes: {_name(first.message.data or b'')} claims"
                )
                text += (
                    f" it at {seconds(first.now)}, and {_name(name)}, which has to yield, says at"
                )
                text += f" {seconds(second.now)} that it has it"
                yield Finding(Cause.ADDRESS_CLASH, second.node, first.now, text, (first, second))
        for (_, name), (node, sight) in self._without.items():
            text = f"the device of NAME {_name(name)} cannot claim {node}, at {seconds(sight.now)}"
            text += ": another one of a smaller NAME has it"
            yield Finding(Cause.ADDRESS_CLASH, node, sight.now, text, (sight,))
        for (bus, name), (first, second) in self._contended.items():
            is_open = name not in insisting and (bus, name) not in self._kept
            if end - second.now > _SETTLED and is_open:
                text = f"{second.node} is claimed by two, at {seconds(second.now)}; NAME"
                text += f" {_name(name)} has to yield, and claims no other address"
                sights = (first, second)
                yield Finding(Cause.ADDRESS_CLASH, second.node, second.now, text, sights)
        for (_, address), said in self._violations.items():
            first = said[0]
            text = f"{first.node} says that another device sends from its address {address}"
            text += f", SPN {VIOLATION_SPN + address} FMI {VIOLATION_FMI} at {seconds(first.now)}"
            yield finding(Cause.ADDRESS_CLASH, first.node, said, text)


class _Left(NamedTuple):
    """An address that a device has left, as it seems, for another one."""

    name: bytes
    claim: Sight
    other: Sight


class Names(OfJ1939):
    """Watches whether two devices have one NAME: one claims another address, and uses both."""

    def __init__(self) -> None:
        self._at: dict[_Device, Sight] = {}
        self._owners: dict[Who, bytes] = {}
        self._left: dict[Who, _Left] = {}
        self._found: dict[_Device, tuple[Sight, Sight, Evidence]] = {}

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        message = sight.message
        if message is None or message.source == signals.NULL:
            return
        who = sight.frame.bus, message.source
        left = self._left.get(who)
        if message.group == signals.ADDRESS_CLAIMED:
            self._hear_claim(who, message, sight)
        elif left is not None and sight.now - left.other.now > _MOVED:
            both = left.claim, left.other, Evidence()
            if len(self._found) < _MOST:
                self._found.setdefault((who[0], left.name), both)[2].append(sight)

    def _hear_claim(self, who: Who, message: J1939Message, sight: Sight) -> None:
        name = message.data
        if name is None or len(name) != signals.NAME_BYTES:
            return
        self._left.pop(who, None)
        before = self._at.get((who[0], name))
        place = (who[0], before.message.source) if before and before.message else who
        is_other = before is not None and place != who and self._owners.get(place) == name
        if before is not None and is_other and len(self._left) < _MOST:
            self._left[place] = _Left(name, before, sight)
        if before is not None or len(self._at) < _MOST:
            self._at[who[0], name] = sight
        if len(self._owners) < _MOST:
            self._owners[who] = name

    def findings(self, end: int) -> Iterator[Finding]:  # noqa: ARG002 - as every watch
        """Yield the NAMEs of two.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """
        for (_, name), (first, second, stays) in self._found.items():
            if stays.total >= _STAYS:
                text = f"{first.node} and {second.node} have the NAME {_name(name)}, and both go on"
                sights = (first, second, stays[0])
                yield Finding(
                    Cause.NAME_CLASH, first.node, second.now, text, sights, others=(second.node,)
                )


@dataclass(slots=True)
class _Life:
    """The frames of a device beside its claims: the last, how many, usual time between two [ns]."""

    last: Sight
    frames: int = 1
    usual: float = 0.0


class _Claim(NamedTuple):
    """A claim that nobody has asked for: whose, its frames before, whether it claimed before."""

    who: Who
    sight: Sight
    life: _Life | None
    is_again: bool


@dataclass(slots=True)
class _Round:
    """Claims that come at once.

    Attributes:
        begin: time of the first one [ns].
        is_busy: other frames came until then.
        claims: those that are not counted yet.
        who: the devices of all.
    """

    begin: int
    is_busy: bool
    claims: list[_Claim] = field(default_factory=list)
    who: set[Who] = field(default_factory=set)


class Restarts(OfJ1939):
    """Watches for devices that claim their address anew after a silence, and nobody has asked."""

    def __init__(self) -> None:
        self._lives: dict[Who, _Life] = {}
        self._names: dict[Who, bytes] = {}
        self._contended: dict[Who, int] = {}
        self._found: dict[Who, tuple[Evidence, int]] = {}  # with the first silence [ns]
        self._again: dict[Who, Evidence] = {}
        self._last: dict[int, int] = {}  # time of the last frame of each bus, but for claims [ns]
        self._rounds: dict[int, _Round] = {}

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        message = sight.message
        if message is None or message.source == signals.NULL:
            return
        who = sight.frame.bus, message.source
        if message.group == signals.ADDRESS_CLAIMED:
            self._hear_claim(who, message, sight)
            return
        self._last[who[0]] = sight.now
        life = self._lives.get(who)
        if life is None:
            if len(self._lives) < _MOST:
                self._lives[who] = _Life(sight)
            return
        interval = sight.now - life.last.now
        life.usual += (interval - life.usual) / min(life.frames, 16)
        life.frames += 1
        life.last = sight

    def _hear_claim(self, who: Who, claim: J1939Message, sight: Sight) -> None:
        name = claim.data
        if name is None:
            return
        before, life = self._names.get(who), self._lives.pop(who, None)
        if before is not None or len(self._names) < _MOST:
            self._names[who] = name
        if before is not None and before != name:
            self._contended[who] = sight.now
            if who[0] in self._rounds:
                claims = self._rounds[who[0]].claims
                claims[:] = [each for each in claims if each.who != who]
            found = self._found.get(who)
            if found is not None and _is_recent(found[0][1].now, sight):
                del self._found[who]  # the claim before was that of a contender
            return
        if claim.is_answer or _is_recent(self._contended.get(who), sight):
            return
        bus, now = who[0], sight.now
        current = self._rounds.get(bus)
        if current is None or now - current.begin > _AT_ONCE:
            self._settle(bus)
            current = _Round(now, now - self._last.get(bus, now) < _DARK)
            self._rounds[bus] = current
        current.claims.append(_Claim(who, sight, life, before is not None))

    def _settle(self, bus: int) -> None:
        """Count the claims of a round; many at once, on a bus that goes on, were asked for."""
        current = self._rounds.get(bus)
        if current is None:
            return
        claims, current.claims = current.claims, []
        current.who.update(each.who for each in claims)
        if current.is_busy and len(current.who) >= _ALL:
            return
        for each in claims:
            self._count(each)

    def _count(self, claim: _Claim) -> None:
        who, sight, life, is_again = claim
        if is_again and len(self._again) < _MOST:
            self._again.setdefault(who, Evidence()).append(sight)
        if life is None or life.frames < _FEWEST:
            return
        dark = sight.now - life.last.now
        if dark >= max(_DARK, _LONGER * life.usual) and len(self._found) < _MOST:
            said, _ = self._found.setdefault(who, (Evidence([life.last]), dark))
            said.append(sight)

    def findings(self, end: int) -> Iterator[Finding]:  # noqa: ARG002 - as every watch
        """Yield the devices that restart.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """
        for bus in self._rounds:
            self._settle(bus)
        for said, silence in self._found.values():
            last, claim = said[0], said[1]
            text = f"{claim.node} sends nothing for {milliseconds(silence)} after"
            text += f" {seconds(last.now)}, and claims its address anew"
            text += f"; {said.total - 1} times" if said.total > 2 else ""
            yield finding(Cause.J1939_RESTART, claim.node, said, text)
        for who, said in self._again.items():
            if said.total >= _AGAIN and who not in self._found:
                text = f"{said[0].node} claims its address again and again, {said.total} times from"
                text += f" {seconds(said[0].now)} on, and nobody has asked it"
                yield finding(Cause.J1939_RESTART, said[0].node, said, text)


def _is_recent(time: int | None, sight: Sight) -> bool:
    return time is not None and sight.now - time < _SETTLED


def _name(name: bytes) -> str:
    return f"0x{int.from_bytes(name, 'little'):016X}"
