"""The kinds of faults of a node on a bus on which frames take time."""

from hil_bench.abilities.faults.checks import FaultDirection, bounded, choose, identifier
from hil_bench.abilities.faults.effects import Acts
from hil_bench.abilities.faults.fault import Effect
from hil_bench.abilities.faults.kind import CAN_ID, DIRECTION, Site, fault_kind
from hil_bench.abilities.faults.line import BitErrors
from hil_bench.abilities.faults.line_kinds import SHARE
from hil_bench.abilities.faults.points import WIRED


@fault_kind(WIRED, keys=(SHARE, DIRECTION, CAN_ID))
def bit_error(
    node: Site,
    share: float = 1.0,
    *,
    direction: FaultDirection | str = FaultDirection.SENT,
    can_id: int | None = None,
) -> Effect:
    """Disturb a bit in a share of a node's frames, 0 to 1, at random, on a bus of copper.

    Without a direction, in those that it sends; "received": it misreads those of others.
    """
    bounded("share", share, low=0.0, high=1.0)
    point = node.point(WIRED)
    chosen = choose("direction", FaultDirection, direction)
    rule = BitErrors(share, identifier(can_id), node.stream())
    sides = [
        side
        for side, each in ((True, FaultDirection.SENT), (False, FaultDirection.RECEIVED))
        if chosen in {each, FaultDirection.BOTH}
    ]

    def begin(_now: int) -> None:
        for is_sent in sides:
            point.disturb(rule, is_sent=is_sent)

    def end(_now: int) -> None:
        for is_sent in sides:
            point.spare(rule, is_sent=is_sent)

    return Acts(begin, end, rule)


@fault_kind(WIRED)
def bus_off(node: Site) -> Effect:
    """Make a node bus-off; afterwards it recovers and sends EMCY 0x8140."""
    point = node.point(WIRED)
    return Acts(point.force_off, point.let_recover)


@fault_kind(WIRED)
def stuck_dominant(node: Site) -> Effect:
    """Let a node's transceiver hold its bus dominant: nobody can send."""
    point = node.point(WIRED)
    return Acts(point.stick, point.unstick)


@fault_kind(WIRED)
def no_acknowledge(node: Site) -> Effect:
    """Pull a node's plug: nobody acknowledges what it sends, and it repeats it."""
    point = node.point(WIRED)
    return Acts(point.pull, point.plug)
