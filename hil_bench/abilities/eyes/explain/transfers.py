"""SDO transfers that failed, and devices that say something else than their EDS."""

from collections.abc import Iterator

from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.explain.finding import (
    EVIDENCE,
    Cause,
    Evidence,
    Finding,
    finding,
    seconds,
)
from hil_bench.abilities.eyes.frame_sights import transfer_title
from hil_bench.abilities.eyes.sight import Service, Sight
from hil_bench.abilities.eyes.transfers import Transfer, Way

_IDENTITY = frozenset({(0x1000, 0), (0x1018, 1), (0x1018, 2), (0x1018, 3)})
_MOST = 4096
_NOT_THERE = frozenset({0x0602_0000, 0x0609_0011})
"""Abort codes of an object or a sub-index that the device does not have."""

_OF_PROFILES = 0x2000
"""First object that CiA 301 does not describe: of it, nobody looks whether it is there."""

_CUT_OFF = 500_000_000
"""A request within this time before the end of the log may still be answered [ns]."""

_Group = tuple[str, int, int, int | None]


class Transfers:
    """Watches how SDO transfers end.

    Args:
        decoder: that gives the sights.
    """

    hears = frozenset({Service.SDO})

    def __init__(self, decoder: Decoder) -> None:
        self._decoder = decoder
        self._aborted: dict[_Group, Evidence] = {}
        self._silent: dict[str, Evidence] = {}
        self._shared: dict[str, Evidence] = {}
        self._differing: dict[tuple[str, int, int], tuple[Sight, str]] = {}

    def hear(self, sight: Sight) -> None:
        """Take a sight."""
        transfer = sight.transfer
        if transfer is None:
            return
        if transfer.is_overtaken and transfer.is_answered:
            self._shared.setdefault(sight.node, Evidence()).append(sight)
        if transfer.abort is not None:
            if self._is_look(sight, transfer):
                return
            group = sight.node, transfer.index, transfer.subindex, transfer.abort
            if group in self._aborted or len(self._aborted) < _MOST:
                self._aborted.setdefault(group, Evidence()).append(sight)
        elif not transfer.is_done:
            self._silent.setdefault(sight.node, Evidence()).append(sight)
        elif difference := self._difference(sight, transfer):
            place = sight.node, transfer.index, transfer.subindex
            self._differing.setdefault(place, (sight, difference))

    def pause(self, length: int) -> None:
        """A transfer that a pause interrupts is one that failed, and told so."""

    def findings(self, end: int) -> Iterator[Finding]:
        """Yield what failed, an object at a time.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """
        differing: dict[str, list[tuple[Sight, str]]] = {}
        for (node, *_), each in self._differing.items():
            differing.setdefault(node, []).append(each)
        for node, found in differing.items():
            text = f"{node}: " + "; ".join(difference for _, difference in found[:EVIDENCE])
            text += f"; so are {len(found) - EVIDENCE} more" if len(found) > EVIDENCE else ""
            sights = Evidence(sight for sight, _ in found)
            yield finding(Cause.OTHER_DEVICE, node, sights, text)
        for node, sights in self._shared.items():
            text = f"{node}: another request came before the answer to {sights[0].words}, "
            text += f"at {seconds(sights[0].now)}"
            text += f", and {sights.total - 1} times more" if sights.total > 1 else ""
            yield finding(Cause.SDO_SHARED, node, sights, text + ": two clients, or one in haste")
        for (node, *_), sights in self._aborted.items():
            first = sights[0]
            again = f", {sights.total} times" if sights.total > 1 else ""
            title = self._title(first)
            text = f"{node}: {title} {first.problem}{again}, first at {seconds(first.now)}"
            yield finding(Cause.SDO_ABORT, node, sights, text)
        for node, sights in self._silent.items():
            late = [s for s in sights if s.transfer and end - s.transfer.end > _CUT_OFF]
            if late:
                transfer = late[0].transfer
                begin = transfer.begin if transfer else late[0].now
                text = f"{node}: {late[0].words} is {late[0].problem}, at {seconds(begin)}"
                text += f"; so are {sights.total - 1} more" if sights.total > 1 else ""
                yield finding(Cause.SDO_NO_ANSWER, node, sights, text, begin)

    def _is_look(self, sight: Sight, transfer: Transfer) -> bool:
        """Return True if somebody has merely looked whether a device has an object."""
        node = self._decoder.nodes.get((sight.frame.bus, sight.node_id or 0))
        is_absent = transfer.way is Way.UPLOAD and transfer.abort in _NOT_THERE
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
