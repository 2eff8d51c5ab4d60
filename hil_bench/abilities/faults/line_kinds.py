"""The kinds of faults of a node on its bus, and of its frames."""

from hil_bench.abilities.faults import checks, line
from hil_bench.abilities.faults.effects import Acts, listed
from hil_bench.abilities.faults.fault import Effect
from hil_bench.abilities.faults.kind import CAN_ID, DIRECTION, LARGEST, Site, fault_kind, percent
from hil_bench.abilities.faults.line import Meeting, Rule
from hil_bench.abilities.faults.points import NODES
from hil_bench.config.settings import Key
from hil_bench.config.values import integer, number, zero_or
from hil_bench.units import MILLISECOND

_MOST_FRAMES = 1000

_FRAMES = (DIRECTION, CAN_ID)
SHARE = percent("share_percent", "share", 100.0)


@fault_kind(NODES)
def silence(node: Site) -> Effect:
    """Cut a node off the bus, as in bus-off: it neither sends nor receives."""
    return listed(node.line().meetings, Meeting(line.silence))


@fault_kind(NODES, lasts=0.0)
def reset(node: Site) -> Effect:
    """Switch a node off, and let it boot at the end; without a duration, at once."""
    point, cut = node.point(NODES), listed(node.line().meetings, Meeting(line.silence))

    def begin(now: int) -> None:
        point.off(now)
        cut.begin(now)

    def end(now: int) -> None:
        cut.end(now)
        point.on(now)

    return Acts(begin, end)


@fault_kind(NODES, keys=(SHARE, *_FRAMES))
def lose(
    node: Site,
    share: float = 1.0,
    *,
    direction: checks.FaultDirection | str = checks.FaultDirection.BOTH,
    can_id: int | None = None,
) -> Effect:
    """Lose a share of a node's frames, 0 to 1, at random."""
    checks.bounded("share", share, low=0.0, high=1.0)
    return _meet(node, line.loss(share, node.stream()), direction, can_id)


_TIME = Key(
    "delay_ms",
    zero_or(number(MILLISECOND, low=1e-3, high=LARGEST)),
    None,
    MILLISECOND,
    "time",
    "5",
)


@fault_kind(NODES, keys=(_TIME, *_FRAMES))
def delay(
    node: Site,
    time: float,
    *,
    direction: checks.FaultDirection | str = checks.FaultDirection.BOTH,
    can_id: int | None = None,
) -> Effect:
    """Delay a node's frames by `time` [s], rounded up to ticks."""
    return _meet(node, line.delay(checks.to_ns("time", time)), direction, can_id)


@fault_kind(NODES, keys=(Key("length", integer(0, 8), example="4"), *_FRAMES))
def truncate(
    node: Site,
    length: int,
    *,
    direction: checks.FaultDirection | str = checks.FaultDirection.SENT,
    can_id: int | None = None,
) -> Effect:
    """Cut or fill a node's data frames to `length` bytes, 0 to 8.

    Without a direction, those that it sends.
    """
    return _meet(node, line.truncation(checks.count("length", length, 0, 8)), direction, can_id)


@fault_kind(NODES, keys=(SHARE, *_FRAMES))
def corrupt(
    node: Site,
    share: float = 1.0,
    *,
    direction: checks.FaultDirection | str = checks.FaultDirection.SENT,
    can_id: int | None = None,
) -> Effect:
    """Flip one bit in a share of a node's data frames, 0 to 1, at random.

    Without a direction, in those that it sends.
    """
    checks.bounded("share", share, low=0.0, high=1.0)
    return _meet(node, line.corruption(share, node.stream()), direction, can_id)


@fault_kind(NODES, keys=_FRAMES)
def repeat(
    node: Site,
    *,
    direction: checks.FaultDirection | str = checks.FaultDirection.SENT,
    can_id: int | None = None,
) -> Effect:
    """Let a node's data frames repeat the first of each identifier, as when it hangs.

    Without a direction, those that it sends.
    """
    return _meet(node, line.repetition(), direction, can_id)


@fault_kind(NODES, keys=(Key("frames_per_tick", integer(1, _MOST_FRAMES), 4), CAN_ID))
def babble(node: Site, frames_per_tick: int = 4, *, can_id: int = 0x001) -> Effect:
    """Let a node flood the bus with frames of an identifier."""
    frames = checks.count("frames_per_tick", frames_per_tick, 1, _MOST_FRAMES)
    send = line.babble(checks.identifier(can_id) or 0, frames, node.point(NODES).bus)
    places = node.places
    return listed(places.finishes, lambda _now: send(places.switchboard.emit))


def _meet(
    node: Site, rule: Rule, direction: checks.FaultDirection | str, can_id: int | None
) -> Effect:
    chosen = checks.choose("direction", checks.FaultDirection, direction)
    return listed(node.line().meetings, Meeting(rule, chosen, checks.identifier(can_id)))
