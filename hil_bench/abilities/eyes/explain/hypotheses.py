"""The fewest causes that explain all that is wrong.

Each finding is an observation, and may be the cause of others. `_LEADS` says which cause leads to
which, how they are bound to each other and from when on. What has a cause among the findings is
told with it; what is left are the causes. Nothing leads to what leads to it, so each log has one
smallest set of them.
"""

from collections.abc import Callable, Iterable
from typing import Final, NamedTuple

from hil_bench.abilities.eyes.explain.finding import Cause, Finding

_SLACK: Final = 1_500_000_000
"""Time before a cause is seen in which its consequences may be seen already [ns].

A node that dies has sent its last PDO before its last heartbeat, or the other way round."""

_OFF_THE_BUS: Final = frozenset({0x8110, 0x8120, 0x8140})
"""EMCY codes of a node that lost frames, went error passive, or came back from bus-off."""

_Bond = Callable[[Finding, Finding], bool]


def _same_node(cause: Finding, effect: Finding) -> bool:
    return cause.node == effect.node


def _anywhere(cause: Finding, effect: Finding) -> bool:
    del cause, effect
    return True


def _awaited(cause: Finding, effect: Finding) -> bool:
    return cause.node == effect.node or cause.node in effect.others


def _given_up(cause: Finding, effect: Finding) -> bool:
    """Return True for a transfer that its client has aborted: a server means what it says."""
    del cause
    transfer = effect.sights[0].transfer if effect.sights else None
    return transfer is not None and transfer.is_aborted_by_client


def _off_the_bus(cause: Finding, effect: Finding) -> bool:
    """Return True if a node says that it lost the bus, and was missed just before or after that."""
    if not _awaited(cause, effect) or _code(cause) not in _OFF_THE_BUS:
        return False
    until = effect.sights[-1].now if effect.sights else effect.begin
    return effect.begin - _SLACK <= cause.begin <= until + _SLACK


class _Lead(NamedTuple):
    """Consequences of a cause.

    Attributes:
        effects: the findings that it explains ...
        bond: ... of these nodes, ...
        slack: ... that begin after it, or no longer than this before [ns]; None for whenever.
    """

    effects: frozenset[Cause]
    bond: _Bond
    slack: int | None = _SLACK


_OF_SDO: Final = frozenset({Cause.SDO_ABORT, Cause.SDO_NO_ANSWER, Cause.SDO_LATE})
_OF_STATE: Final = frozenset({Cause.NOT_STARTED, Cause.START_REFUSED, Cause.STATE_LEFT})
_OF_PDO: Final = frozenset({Cause.PDO_MISSING, Cause.RPDO_TIMEOUT, Cause.ABSENT_PRODUCER})
_OF_SETTINGS: Final = frozenset({Cause.MAPPING, Cause.PDO_LENGTH, Cause.PDO_TIMERS})
_OF_SYNC: Final = frozenset({Cause.SYNC_MISSING, Cause.SYNC_JITTER})
_OF_J1939: Final = frozenset(
    {
        Cause.J1939_SILENT,
        Cause.J1939_RESTART,
        Cause.J1939_MISSING,
        Cause.J1939_TRANSFER,
        Cause.J1939_REQUEST,
        Cause.J1939_PACE,
        Cause.J1939_PERIOD,
    }
)
_OF_TWO_J1939: Final = _OF_J1939 | {
    Cause.J1939_LENGTH,
    Cause.J1939_PRIORITY,
    Cause.J1939_INDICATOR,
}
_OF_TRAFFIC: Final = (
    _OF_SDO - {Cause.SDO_ABORT} | _OF_PDO | _OF_SYNC | _OF_J1939 | {Cause.HEARTBEAT_LOST}
)
_OF_NODE: Final = _OF_SDO | _OF_STATE | _OF_PDO | {Cause.HEARTBEAT_LOST, Cause.EMCY}

_GIVEN_UP: Final = _Lead(frozenset({Cause.SDO_ABORT}), _given_up)

_LEADS: Final[dict[Cause, tuple[_Lead, ...]]] = {
    Cause.OTHER_BUS: (_Lead(frozenset(Cause) - {Cause.OTHER_BUS}, _anywhere, slack=None),),
    Cause.TWO_RECORDINGS: (
        _Lead(frozenset(Cause) - {Cause.OTHER_BUS, Cause.TWO_RECORDINGS}, _anywhere, slack=None),
    ),
    Cause.TWO_BUSES: (
        _Lead(
            frozenset(Cause) - {Cause.OTHER_BUS, Cause.TWO_RECORDINGS, Cause.TWO_BUSES},
            _anywhere,
            slack=None,
        ),
    ),
    Cause.BUS_SILENT: (_Lead(_OF_TRAFFIC, _anywhere), _GIVEN_UP),
    Cause.ERROR_FRAMES: (
        _Lead(_OF_TRAFFIC | {Cause.BUS_SILENT, Cause.PDO_LOST, Cause.PDO_REPEATED}, _anywhere),
        _GIVEN_UP,
    ),
    Cause.BUS_LOAD: (_Lead(_OF_TRAFFIC | {Cause.PDO_LOST}, _anywhere), _GIVEN_UP),
    Cause.NO_BOOT_UP: (
        _Lead(_OF_NODE, _awaited, slack=None),
        _Lead(frozenset({Cause.SYNC_MISSING}), _awaited, slack=None),
    ),
    Cause.NODE_ID_CLASH: (
        _Lead(
            _OF_NODE
            | {Cause.RESTART, Cause.OTHER_DEVICE, Cause.PDO_LENGTH, Cause.MAPPING}
            | {Cause.PDO_REPEATED, Cause.PDO_LOST},
            _same_node,
            slack=None,
        ),
    ),
    Cause.IDENTIFIER_CLASH: (
        _Lead(
            _OF_PDO | {Cause.PDO_LENGTH, Cause.PDO_LOST, Cause.PDO_REPEATED},
            _awaited,
            slack=None,
        ),
    ),
    Cause.NAME_CLASH: (_Lead(_OF_TWO_J1939 | {Cause.ADDRESS_CLASH}, _awaited),),
    Cause.ADDRESS_CLASH: (_Lead(_OF_TWO_J1939, _same_node), _Lead(_OF_J1939, _awaited)),
    Cause.RESTART: (_Lead(_OF_NODE, _awaited), _Lead(frozenset({Cause.SYNC_MISSING}), _awaited)),
    Cause.OTHER_DEVICE: (
        _Lead(_OF_SDO | _OF_PDO | {Cause.PDO_LENGTH, Cause.MAPPING}, _same_node, slack=None),
    ),
    Cause.MAPPING: (_Lead(frozenset({Cause.PDO_LENGTH, Cause.EMCY}), _same_node),),
    Cause.PDO_TIMERS: (_Lead(frozenset({Cause.PDO_MISSING}), _same_node, slack=None),),
    Cause.SYNC_TWICE: (_Lead(_OF_SYNC | {Cause.SYNC_PERIOD}, _anywhere, slack=None),),
    Cause.SYNC_PERIOD: (_Lead(frozenset({Cause.EMCY, *_OF_SYNC}), _anywhere),),
    Cause.SDO_LATE: (
        _Lead(frozenset({Cause.SDO_ABORT, Cause.SDO_NO_ANSWER}), _same_node, slack=None),
        _Lead(_OF_STATE, _same_node),
    ),
    Cause.SDO_SHARED: (_Lead(_OF_SDO, _same_node, slack=None),),
    Cause.SDO_ABORT: (_Lead(_OF_STATE | _OF_PDO | _OF_SETTINGS, _same_node, 0),),
    Cause.SDO_NO_ANSWER: (_Lead(_OF_STATE | _OF_PDO | _OF_SETTINGS, _same_node, 0),),
    Cause.NOT_STARTED: (_Lead(_OF_PDO, _awaited),),
    Cause.START_REFUSED: (_Lead(_OF_PDO, _awaited),),
    Cause.STATE_LEFT: (_Lead(_OF_PDO, _awaited),),
    Cause.HEARTBEAT_LOST: (
        _Lead(_OF_SDO | _OF_PDO | {Cause.STATE_LEFT}, _awaited),
        _Lead(frozenset({Cause.SYNC_MISSING}), _awaited),
    ),
    Cause.EMCY: (
        _Lead(_OF_STATE, _same_node, 0),
        _Lead(frozenset({Cause.PDO_MISSING}), _same_node),
        _Lead(_OF_NODE - {Cause.EMCY}, _off_the_bus, slack=None),
    ),
    Cause.J1939_RESTART: (_Lead(_OF_J1939 - {Cause.J1939_RESTART}, _awaited),),
    Cause.J1939_SILENT: (_Lead(_OF_J1939 - {Cause.J1939_SILENT, Cause.J1939_RESTART}, _awaited),),
    Cause.J1939_PACE: (_Lead(frozenset({Cause.J1939_TRANSFER}), _same_node, slack=None),),
    Cause.TROUBLE_CODE: (_Lead(frozenset({Cause.J1939_INDICATOR}), _same_node),),
    Cause.J1939_LENGTH: (_Lead(frozenset({Cause.J1939_INDICATOR}), _same_node),),
    Cause.J1939_PERIOD: (_Lead(frozenset({Cause.J1939_MISSING}), _same_node),),
    Cause.PDO_LENGTH: (_Lead(_OF_PDO, _same_node),),
    Cause.SYNC_MISSING: (_Lead(_OF_PDO, _anywhere),),
}

_REPORTED: Final = {
    0x8130: frozenset({Cause.HEARTBEAT_LOST, Cause.NO_BOOT_UP, Cause.RESTART, Cause.BUS_SILENT}),
    0x8210: frozenset({Cause.PDO_LENGTH, Cause.MAPPING}),
    0x8220: frozenset({Cause.PDO_LENGTH, Cause.MAPPING}),
    0x8240: frozenset({Cause.SYNC_COUNTER}),
    0x8250: frozenset({Cause.RPDO_TIMEOUT, Cause.HEARTBEAT_LOST, Cause.BUS_SILENT}),
}
"""EMCY codes, and the findings that are their reason on whatever node."""

_ORDER: Final = {cause: number for number, cause in enumerate(Cause)}


def fewest(found: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return the causes that explain all findings, each with its consequences.

    Args:
        found: all that is wrong.

    Returns:
        In the order in which an expert looks.
    """
    findings = sorted(found, key=lambda each: (_ORDER[each.cause], each.begin))
    explained: dict[int, list[Finding]] = {}
    causes: list[Finding] = []
    roots: dict[int, Finding] = {}
    for effect in findings:
        by = [cause for cause in findings if cause is not effect and _leads(cause, effect)]
        if by:
            explained.setdefault(id(by[0]), []).append(effect)
            roots[id(effect)] = by[0]
        else:
            causes.append(effect)
    return tuple(each._replace(consequences=tuple(_all_of(each, explained))) for each in causes)


def _all_of(cause: Finding, explained: dict[int, list[Finding]]) -> list[Finding]:
    """Return all that a cause explains, and what that explains in turn."""
    found: list[Finding] = []
    for effect in explained.get(id(cause), ()):
        found += [effect, *_all_of(effect, explained)]
    return found


def _leads(cause: Finding, effect: Finding) -> bool:
    if effect.cause is Cause.EMCY and cause.cause in _REPORTED.get(_code(effect), ()):
        return True
    return any(
        effect.cause in lead.effects
        and lead.bond(cause, effect)
        and (lead.slack is None or effect.begin >= cause.begin - max(lead.slack, effect.span))
        for lead in _LEADS.get(cause.cause, ())
    )


def _code(finding: Finding) -> int:
    code = finding.sights[0].emcy_code if finding.sights else None
    return 0 if code is None else code
