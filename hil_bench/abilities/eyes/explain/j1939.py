"""Faults on J1939: addresses, transfers, requests, missing messages, trouble codes."""

from collections.abc import Iterator
from typing import Final

from hil_bench.abilities.eyes.explain.finding import (
    Cause,
    Evidence,
    Finding,
    finding,
    milliseconds,
    seconds,
)
from hil_bench.abilities.eyes.j1939 import group_name, trouble_codes
from hil_bench.abilities.eyes.sight import Service, Sight
from hil_bench.abilities.j1939.protocol.identifier import (
    ACKNOWLEDGEMENT,
    ADDRESS_CLAIMED,
    DM1,
    GLOBAL,
    NULL,
    REQUEST,
)
from hil_bench.abilities.j1939.protocol.name import NAME_BYTES

_MS: Final = 1_000_000
_ANSWER: Final = 1250 * _MS
"""Longest time from a request to its answer, T3 of J1939-21 [ns]."""


_MOST: Final = 4096
_VIOLATION_SPN: Final = 2000
_VIOLATION_FMI: Final = 31
_REFUSALS: Final = {1: "refused", 2: "access denied", 3: "cannot respond"}

Who = tuple[int, int]
"""Bus and address."""


class OfJ1939:
    """A watch of J1939 messages, to which pauses of the bus mean nothing."""

    hears = frozenset({Service.J1939})

    def pause(self, length: int) -> None:
        """Nothing of it depends on the time."""


class Addresses(OfJ1939):
    """Watches who claims which address, and who has none."""

    def __init__(self) -> None:
        self._owners: dict[Who, tuple[bytes, Sight]] = {}
        self._without: dict[tuple[int, bytes], Sight] = {}
        self._contended: dict[tuple[int, bytes], tuple[Sight, Sight]] = {}
        self._violations: dict[Who, Evidence] = {}

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        message = sight.message
        if message is None or message.data is None:
            return
        bus = sight.frame.bus
        if message.group == ADDRESS_CLAIMED and len(message.data) == NAME_BYTES:
            self._hear_claim(bus, message.source, message.data, sight)
        elif message.group == DM1:
            for spn, fmi in trouble_codes(message.data):
                if fmi == _VIOLATION_FMI and spn - _VIOLATION_SPN == message.source:
                    self._violations.setdefault((bus, message.source), Evidence()).append(sight)

    def _hear_claim(self, bus: int, address: int, name: bytes, sight: Sight) -> None:
        if address == NULL:  # without a contender it merely signs off
            if self._contended.pop((bus, name), None) is not None:
                self._without.setdefault((bus, name), sight)
            return
        self._without.pop((bus, name), None)
        self._contended.pop((bus, name), None)
        owner = self._owners.get((bus, address))
        if owner is not None and owner[0] != name:
            loser = max(owner[0], name, key=lambda each: int.from_bytes(each, "little"))
            self._contended[bus, loser] = owner[1], sight
        if len(self._owners) < _MOST:
            self._owners[bus, address] = name, sight

    def findings(self, end: int) -> Iterator[Finding]:
        """Yield the devices without an address, and the addresses of two.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """
        for (_, name), sight in self._without.items():
            text = (
                f"the device of NAME {_name(name)} cannot claim an address, at {seconds(sight.now)}"
            )
            text += ": another one of a smaller NAME has it"
            yield Finding(Cause.ADDRESS_CLASH, sight.node, sight.now, text, (sight,))
        for (_, name), (first, second) in self._contended.items():
            if end - second.now > _ANSWER:
                text = f"{second.node} is claimed by two, at {seconds(second.now)}; NAME"
                text += f" {_name(name)} has to yield, and claims no other address"
                sights = (first, second)
                yield Finding(Cause.ADDRESS_CLASH, second.node, second.now, text, sights)
        for (_, address), said in self._violations.items():
            first = said[0]
            text = f"{first.node} says that another device sends from its address {address}"
            text += f", SPN {_VIOLATION_SPN + address} FMI {_VIOLATION_FMI} at {seconds(first.now)}"
            yield finding(Cause.ADDRESS_CLASH, first.node, said, text)


class LongTransfers(OfJ1939):
    """Keeps the long messages that did not arrive."""

    def __init__(self) -> None:
        self._failed: dict[tuple[str, int, int], Evidence] = {}

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        message = sight.message
        if message is not None and sight.problem and len(self._failed) < _MOST:
            key = sight.node, message.group, message.destination
            self._failed.setdefault(key, Evidence()).append(sight)

    def findings(self, end: int) -> Iterator[Finding]:  # noqa: ARG002 - as every watch
        """Yield them, a sender and a group at a time.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """
        for (node, group, _), sights in self._failed.items():
            first = sights[0]
            text = f"{node}: {group_title(group)}: {first.problem}, first at {seconds(first.now)}"
            text += f"; {sights.total} such" if sights.total > 1 else ""
            yield finding(Cause.J1939_TRANSFER, node, sights, text)


class Requests(OfJ1939):
    """Watches requests that are sent to one device."""

    def __init__(self) -> None:
        self._open: dict[tuple[int, int, int], Sight] = {}
        self._failed: list[tuple[Sight, str]] = []

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        message = sight.message
        if message is None:
            return
        bus, data = sight.frame.bus, message.data or b""
        if message.group == REQUEST and message.destination != GLOBAL and len(data) >= 3:
            if len(self._open) < _MOST:
                group = int.from_bytes(data[:3], "little")
                self._open.setdefault((bus, message.destination, group), sight)
        elif message.group == ACKNOWLEDGEMENT and len(data) == 8:
            key = bus, message.source, int.from_bytes(data[5:], "little")
            asked = self._open.pop(key, None)
            if asked is not None and data[0] in _REFUSALS:
                self._fail(asked, _REFUSALS[data[0]])
        else:
            asked = self._open.pop((bus, message.source, message.group), None)
            if asked is not None and message.begin - asked.now > _ANSWER:
                late = milliseconds(message.begin - asked.now)
                self._fail(asked, f"answered after {late}, {milliseconds(_ANSWER)} are right")

    def findings(self, end: int) -> Iterator[Finding]:
        """Yield the requests that failed.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """
        silent = [(s, "not answered") for s in self._open.values() if end - s.now > _ANSWER]
        for sight, what in [*self._failed, *silent]:
            text = f"{sight.node}: {sight.words}: {what}, at {seconds(sight.now)}"
            yield Finding(Cause.J1939_REQUEST, sight.node, sight.now, text, (sight,))

    def _fail(self, sight: Sight, why: str) -> None:
        if len(self._failed) < _MOST:
            self._failed.append((sight, why))


class TroubleCodes(OfJ1939):
    """Keeps what devices report by DM1."""

    def __init__(self) -> None:
        self._found: dict[tuple[str, int, int], Evidence] = {}

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        message = sight.message
        if message is None or message.group != DM1 or message.data is None:
            return
        for spn, fmi in trouble_codes(message.data):
            if fmi == _VIOLATION_FMI and spn - _VIOLATION_SPN == message.source:
                continue
            if len(self._found) < _MOST:
                self._found.setdefault((sight.node, spn, fmi), Evidence()).append(sight)

    def findings(self, end: int) -> Iterator[Finding]:  # noqa: ARG002 - as every watch
        """Yield each code.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """
        for (node, spn, fmi), sights in self._found.items():
            first = sights[0]
            text = f"{node} reports SPN {spn} FMI {fmi}, from {seconds(first.now)} on"
            yield finding(Cause.TROUBLE_CODE, node, sights, text)


def group_title(group: int) -> str:
    """Return the number and the name of a parameter group."""
    name = group_name(group)
    return f"PGN {group}" + (f" {name}" if name else "")


def _name(name: bytes) -> str:
    return f"0x{int.from_bytes(name, 'little'):016X}"
