"""Faults on J1939: transfers, requests, trouble codes."""

from collections.abc import Iterator
from typing import Final

from hil_bench.abilities.eyes.explain.finding import (
    Cause,
    Evidence,
    Finding,
    finding,
    listed,
    milliseconds,
    seconds,
    together,
)
from hil_bench.abilities.eyes.j1939 import group_name, lamps_of, trouble_codes
from hil_bench.abilities.eyes.sight import Service, Sight
from hil_bench.abilities.j1939.protocol import signals

_MS: Final = 1_000_000
_ANSWER: Final = 1250 * _MS
"""Longest time from a request to its answer, T3 of J1939-21 [ns]."""

_MOST: Final = 4096
VIOLATION_SPN: Final = 2000
VIOLATION_FMI: Final = 31
"""Trouble code of a device from whose address another one sends: SPN 2000 + address, FMI 31."""

_REFUSALS: Final = {1: "refused", 2: "access denied", 3: "cannot respond"}

Who = tuple[int, int]
"""Bus and address."""


class OfJ1939:
    """A watch of J1939 messages, to which pauses of the bus mean nothing."""

    hears = frozenset({Service.J1939})

    def pause(self, length: int) -> None:
        """Nothing of it depends on the time."""


class LongTransfers(OfJ1939):
    """Keeps the long messages that did not arrive, and those at a wrong pace."""

    def __init__(self) -> None:
        self._failed: dict[tuple[Cause, str, int, int], Evidence] = {}

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        message = sight.message
        if message is not None and sight.problem and len(self._failed) < _MOST:
            cause = Cause.J1939_TRANSFER if message.data is None else Cause.J1939_PACE
            key = cause, sight.node, message.group, message.destination
            self._failed.setdefault(key, Evidence()).append(sight)

    def findings(self, end: int) -> Iterator[Finding]:  # noqa: ARG002 - as every watch
        """Yield them, a sender and a group at a time; with the one who did not do what was due.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """
        for (cause, node, group, _), sights in self._failed.items():
            first = sights[0]
            receiver = first.message.receiver if first.message is not None else ""
            text = f"{node}: {group_title(group)}{f' to {receiver}' if receiver else ''}: "
            text += f"{first.problem}, first at {seconds(first.now)}"
            text += f"; {sights.total} such" if sights.total > 1 else ""
            found = finding(cause, _culprit(first), sights, text)
            yield found._replace(others=tuple({node, receiver} - {"", found.node}))


def _culprit(sight: Sight) -> str:
    """Return the one whose fault it is that a message did not arrive: receiver or sender."""
    message = sight.message
    if message is not None and message.culprit == message.destination and message.receiver:
        return message.receiver
    return sight.node


class Requests(OfJ1939):
    """Watches requests that are sent to one device."""

    def __init__(self) -> None:
        self._open: dict[tuple[int, int, int], Sight] = {}
        self._failed: dict[tuple[str, str, str], Evidence] = {}
        self._heard: set[Who] = set()

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        message = sight.message
        if message is None:
            return
        bus, data = sight.frame.bus, message.data or b""
        if len(self._heard) < _MOST:
            self._heard.add((bus, message.source))
        if (
            message.group == signals.REQUEST
            and message.destination != signals.GLOBAL
            and len(data) >= 3
        ):
            if len(self._open) < _MOST:
                group = int.from_bytes(data[:3], "little")
                self._open.setdefault((bus, message.destination, group), sight)
        elif message.group == signals.ACKNOWLEDGEMENT and len(data) == 8:
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
        """Yield the requests that failed, those alike as one.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """
        silent = {
            (s.node, s.words, "not answered"): Evidence([s])
            for (bus, asked, group), s in self._open.items()
            if end - s.now > _ANSWER
            # Who asks at an address of nobody for its claim looks whether it is free.
            if group != signals.ADDRESS_CLAIMED or (bus, asked) in self._heard
        }
        alike: dict[tuple[str, str, str], dict[str, Evidence]] = {}
        for (node, words, what), sights in [*self._failed.items(), *silent.items()]:
            whom, _, group = words.partition(": ")
            alike.setdefault((node, whom, what), {})[group] = sights
        for (node, whom, what), groups in alike.items():
            sights = together(groups.values())
            first = sights[0]
            text = f"{node}: {whom}: {listed(groups)}: {what}, at {seconds(first.now)}"
            text += f"; {sights.total} times" if sights.total > len(groups) else ""
            receiver = first.message.receiver if first.message is not None else ""
            found = finding(Cause.J1939_REQUEST, node, sights, text)
            yield found._replace(others=(receiver,))

    def _fail(self, sight: Sight, why: str) -> None:
        key = sight.node, sight.words, why
        if key in self._failed or len(self._failed) < _MOST:
            self._failed.setdefault(key, Evidence()).append(sight)


class TroubleCodes(OfJ1939):
    """Keeps what devices report by DM1: codes, and lamps without one."""

    def __init__(self) -> None:
        self._found: dict[tuple[str, int, int], Evidence] = {}
        self._lamps: dict[tuple[str, str], Evidence] = {}

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        message = sight.message
        if message is None or message.group != signals.DM1 or message.data is None:
            return
        codes, lamps = trouble_codes(message.data), lamps_of(message.data)
        if not codes and lamps and len(self._lamps) < _MOST:
            self._lamps.setdefault((sight.node, " and ".join(lamps)), Evidence()).append(sight)
        for spn, fmi in codes:
            if fmi == VIOLATION_FMI and spn - VIOLATION_SPN == message.source:
                continue
            if len(self._found) < _MOST:
                self._found.setdefault((sight.node, spn, fmi), Evidence()).append(sight)

    def findings(self, end: int) -> Iterator[Finding]:  # noqa: ARG002 - as every watch
        """Yield the codes that a device reported at once, and each device with a lamp and no code.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """
        at_once: dict[tuple[str, int], dict[str, Evidence]] = {}
        for (node, spn, fmi), sights in self._found.items():
            at_once.setdefault((node, sights[0].now), {})[f"SPN {spn} FMI {fmi}"] = sights
        for (node, begin), codes in at_once.items():
            text = f"{node} reports {listed(codes)}, from {seconds(begin)} on"
            yield finding(Cause.TROUBLE_CODE, node, next(iter(codes.values())), text)
        for (node, lamps), sights in self._lamps.items():
            text = f"{node} has lamp {lamps} on and reports no trouble code, from"
            text += f" {seconds(sights[0].now)} on"
            yield finding(Cause.TROUBLE_CODE, node, sights, text)


def group_title(group: int) -> str:
    """Return the number and the name of a parameter group."""
    name = group_name(group)
    return f"PGN {group}" + (f" {name}" if name else "")
