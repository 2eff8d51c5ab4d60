"""Counters of protected PDOs: frames that were lost, repeated or overtaken, and what stands."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from hil_bench.abilities.eyes.explain.finding import Cause, Finding, seconds
from hil_bench.abilities.eyes.known_node import KnownNode, PdoOwner
from hil_bench.abilities.eyes.sight import Sight
from hil_bench.canopen_device.pdo_protection import SEAL_BYTES

_MODULUS: Final = 256
_BACK: Final = 128
"""Step of a counter from which it went back rather than on."""


@dataclass(slots=True)
class _Standstill:
    """Frames whose counter is that of the frame before them."""

    counter: int
    sights: list[Sight]


@dataclass(slots=True)
class _Jump:
    """A counter that went on by more than one, or back."""

    before: int
    after: int
    lost: int
    sight: Sight


@dataclass(slots=True)
class _Count:
    """The course of one PDO's counter."""

    owner: PdoOwner
    last: int | None = None
    spoilt: int = 0
    """Frames that were altered or repeated since the last that was neither."""
    sealed: int = 0
    unsealed: int = 0
    is_standing: bool = False
    standstills: list[_Standstill] = field(default_factory=list)
    jumps: list[_Jump] = field(default_factory=list)


class Counters:
    """Follows the counter of each protected PDO."""

    def __init__(self) -> None:
        self._counts: dict[tuple[int, str], _Count] = {}

    def take(self, owner: PdoOwner, sight: Sight) -> bool:
        """Follow a frame of a PDO.

        Args:
            owner: the PDO.
            sight: the frame.

        Returns:
            Whether its counter says that frames before it were sent, and did not arrive.
        """
        data = sight.frame.data
        place = owner.address, owner.node.name
        if not owner.pdo.is_sealed(data) or owner.pdo.problem(data):
            if (known := self._counts.get(place)) is not None:
                known.unsealed += 1
                known.spoilt += 1
            return False
        count = self._counts.setdefault(place, _Count(owner))
        count.owner, count.sealed = owner, count.sealed + 1
        counter, last = data[-SEAL_BYTES], count.last
        if counter == last:
            self._repeat(count, counter, sight)
            return False
        spoilt, count.last, count.spoilt, count.is_standing = count.spoilt, counter, 0, False
        step = 1 if last is None else (counter - last) % _MODULUS
        if last is None or step - 1 <= spoilt:
            return False
        lost = step - 1 - spoilt if step < _BACK else 0
        count.jumps.append(_Jump(last, counter, lost, sight))
        return lost > 0

    def _repeat(self, count: _Count, counter: int, sight: Sight) -> None:
        if not count.is_standing:
            count.standstills.append(_Standstill(counter, []))
        count.standstills[-1].sights.append(sight)
        count.is_standing = True
        count.spoilt += 1

    def forget(self, node: KnownNode) -> None:
        """Let the counters of a node begin anew, as after a reset."""
        for count in self._counts.values():
            if count.owner.node is node:
                count.last, count.spoilt, count.is_standing = None, 0, False

    def findings(self) -> Iterator[Finding]:
        """Yield the counters that did not go on by one.

        A PDO of which nobody says that it is protected counts as such if most of its frames have a
        right checksum.
        """
        for count in self._counts.values():
            if count.owner.pdo.is_protected or count.sealed > count.unsealed:
                if count.standstills:
                    yield _standstill_finding(count)
                if count.jumps:
                    yield _jump_finding(count)


def _standstill_finding(count: _Count) -> Finding:
    (node, pdo), first = count.owner, count.standstills[0]
    times = len(first.sights)
    text = f"{node.name} {pdo.name}: counter stands at {first.counter} from "
    text += f"{seconds(first.sights[0].now)} on, {times} frames repeated"
    if times == 1:
        text = f"{node.name} {pdo.name}: frame with counter {first.counter} repeated at "
        text += seconds(first.sights[0].now)
    if others := len(count.standstills) - 1:
        repeated = sum(len(each.sights) for each in count.standstills)
        text += f"; {others} times more, {repeated} frames repeated in all"
    sights = tuple(sight for each in count.standstills for sight in each.sights)
    return Finding(Cause.PDO_REPEATED, node.name, sights[0].now, text, sights)


def _jump_finding(count: _Count) -> Finding:
    (node, pdo), first = count.owner, count.jumps[0]
    way = "" if first.lost else "back "
    text = f"{node.name} {pdo.name}: counter goes {way}from {first.before} to {first.after}"
    text += f" at {seconds(first.sight.now)}"
    text += f", {first.lost} sent and not seen" if first.lost else ", overtaken or started anew"
    if others := len(count.jumps) - 1:
        lost = sum(each.lost for each in count.jumps)
        text += f"; {others} times more, {lost} not seen in all"
    sights = tuple(each.sight for each in count.jumps)
    return Finding(Cause.PDO_LOST, node.name, first.sight.now, text, sights)
