"""Reads a log from its first to its last frame and says what is wrong."""

from collections.abc import Iterable
from collections.abc import Set as AbstractSet
from typing import NamedTuple

from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.explain.bus import EXPLAINED, Emergencies, ErrorFrames, Load, Syncs
from hil_bench.abilities.eyes.explain.finding import Cause, Finding, Watch
from hil_bench.abilities.eyes.explain.heartbeats import Heartbeats
from hil_bench.abilities.eyes.explain.j1939 import (
    Addresses,
    Cycles,
    LongTransfers,
    Requests,
    TroubleCodes,
)
from hil_bench.abilities.eyes.explain.presence import Presence
from hil_bench.abilities.eyes.explain.process_data import ProcessData
from hil_bench.abilities.eyes.explain.transfers import Transfers
from hil_bench.abilities.eyes.known_ecu import KnownEcu
from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.devices.j1939.identifier import NULL
from hil_bench.outside.recording.logged_frame import LoggedFrame, from_first

_OF_SDO = frozenset({Cause.SDO_ABORT, Cause.SDO_NO_ANSWER})
_AT_ONCE = 5_000_000
"""Time within which the PDOs of several nodes stay out together [ns]."""

_ORDER = {cause: number for number, cause in enumerate(Cause)}


class Explanation(NamedTuple):
    """The explanation of a log.

    Attributes:
        findings: what is wrong, causes before what they lead to.
        frames: how many there were.
        duration: from the first to the last [s].
        nodes: names of those that were heard or spoken to.
        load: share of the bus's time that was taken [-].
    """

    findings: tuple[Finding, ...]
    frames: int
    duration: float
    nodes: tuple[str, ...]
    load: float


def explain(
    frames: Iterable[LoggedFrame],
    known: Iterable[KnownNode],
    bitrate: int,
    ecus: Iterable[KnownEcu] = (),
) -> Explanation:
    """Explain a log: find its faults and their causes.

    Args:
        frames: of one bus, in the order of time.
        known: the nodes that ought to be there.
        bitrate: of the bus [bit/s].
        ecus: the J1939 devices that ought to be there.
    """
    nodes = list(known)
    decoder = Decoder(nodes, ecus)
    load, presence = Load(bitrate), Presence(decoder, nodes)
    watches: tuple[Watch, ...] = (
        presence,
        Heartbeats(decoder),
        Transfers(decoder),
        ProcessData(decoder),
        ErrorFrames(),
        Syncs(),
        Emergencies(),
        Addresses(),
        LongTransfers(),
        Requests(),
        Cycles(),
        TroubleCodes(),
    )
    senders: dict[str, None] = {}
    now = count = 0
    for logged in from_first(frames):
        now, count = logged.now, count + 1
        frame = logged.frame
        load.count(now, len(frame.data), is_extended=frame.is_extended)
        for sight in decoder.take(logged):
            if sight.message is not None and sight.message.source != NULL:
                senders[sight.node] = None
            for watch in watches:
                watch.hear(sight)
    for sight in decoder.finish():
        for watch in watches:
            watch.hear(sight)
    found = [finding for watch in watches for finding in watch.findings(now)]
    found += load.findings(now)
    duration = now * 1e-9
    return Explanation(
        tuple(
            sorted(
                _together(_without_echoes(found, presence.scanned)),
                key=lambda each: (_ORDER[each.cause], each.begin),
            )
        ),
        count,
        duration,
        (*(node.name for _, node in sorted(decoder.nodes.items())), *senders),
        load.total / (bitrate * duration) if duration else 0.0,
    )


def _together(findings: list[Finding]) -> list[Finding]:
    """Tell once what the PDOs of several nodes do at one time: whoever they wait for was late."""
    alone: list[Finding] = []
    groups: list[list[Finding]] = []
    for finding in sorted(findings, key=lambda each: each.begin):
        if finding.cause is not Cause.PDO_MISSING:
            alone.append(finding)
        elif groups and finding.begin - groups[-1][0].begin < _AT_ONCE:
            groups[-1].append(finding)
        else:
            groups.append([finding])
    return alone + [_joined(group) for group in groups]


def _joined(group: list[Finding]) -> Finding:
    first = group[0]
    others = ", ".join(dict.fromkeys(each.node for each in group[1:] if each.node != first.node))
    return first._replace(text=f"{first.text}; at the same time {others}") if others else first


def _without_echoes(findings: list[Finding], scanned: AbstractSet[str]) -> list[Finding]:
    """Leave out what only repeats a cause: of a node that is not there, its missing answers."""
    causes = {finding.cause for finding in findings}
    gone = {
        finding.node
        for finding in findings
        if finding.cause in {Cause.NO_BOOT_UP, Cause.HEARTBEAT_LOST}
    }
    echoes = {Cause.SDO_NO_ANSWER, Cause.PDO_MISSING}
    slow = {finding.node for finding in findings if finding.cause is Cause.SDO_LATE}
    return [
        finding
        for finding in findings
        if not (finding.cause in echoes and finding.node in gone)
        and not (finding.cause in _OF_SDO and finding.node in scanned)
        and not (finding.cause is Cause.SDO_ABORT and finding.node in slow)
        and not (finding.cause is Cause.EMCY and _reason(finding) in causes)
    ]


def _reason(finding: Finding) -> Cause | None:
    code = finding.sights[0].emcy_code
    return None if code is None else EXPLAINED.get(code)
