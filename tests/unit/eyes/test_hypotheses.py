"""The fewest causes: what leads to what, and what stands alone."""

import pytest

from hil_bench.abilities.eyes.explain.finding import Cause, Finding
from hil_bench.abilities.eyes.explain.hypotheses import fewest
from hil_bench.abilities.eyes.sight import Service, Sight
from hil_bench.abilities.eyes.transfers import Transfer, Way
from hil_bench.canopen_device.frame import Frame

S = 1_000_000_000


def found(cause, node="node 2", begin=0, others=()):
    return Finding(cause, node, begin, "", others=others)


def told(*findings):
    return [
        (each.cause, [effect.cause for effect in each.consequences]) for each in fewest(findings)
    ]


@pytest.mark.parametrize(
    ("cause", "effect", "is_explained"),
    [
        (found(Cause.HEARTBEAT_LOST), found(Cause.PDO_MISSING), True),
        (found(Cause.HEARTBEAT_LOST), found(Cause.PDO_MISSING, "node 3"), False),
        # Its answers were missing long before it fell silent.
        (found(Cause.HEARTBEAT_LOST, begin=9 * S), found(Cause.SDO_NO_ANSWER, begin=S), False),
        (found(Cause.NO_BOOT_UP, begin=9 * S), found(Cause.SDO_NO_ANSWER, begin=S), True),
        (found(Cause.NO_BOOT_UP), found(Cause.ABSENT_PRODUCER, "node 3", others=("node 2",)), True),
        (found(Cause.NO_BOOT_UP), found(Cause.ABSENT_PRODUCER, "node 3"), False),
        (found(Cause.BUS_SILENT, ""), found(Cause.SYNC_MISSING, ""), True),
        (found(Cause.EMCY), found(Cause.STATE_LEFT), True),
        (found(Cause.SYNC_MISSING, ""), found(Cause.PDO_MISSING, "node 7"), True),
        (found(Cause.SYNC_JITTER, ""), found(Cause.PDO_MISSING, "node 7"), False),
    ],
)
def test_a_cause_explains_what_it_leads_to(cause, effect, is_explained):
    causes = told(effect, cause)
    if is_explained:
        assert causes == [(cause.cause, [effect.cause])]
    else:
        assert sorted(each.name for each, _ in causes) == sorted(
            [cause.cause.name, effect.cause.name]
        )


@pytest.mark.parametrize(("by_client", "is_explained"), [(True, True), (False, False)])
def test_a_server_means_its_abort_whatever_the_bus_does(by_client, is_explained):
    frame = Frame(0x582, b"\x80\0\x10\0\0\0\2\6")
    transfer = Transfer(Way.UPLOAD, 0x1000, 0, 0, abort=1, is_aborted_by_client=by_client)
    sight = Sight(0, frame, Service.SDO, "SDO", "node 2", 2, transfer=transfer)
    abort = Finding(Cause.SDO_ABORT, "node 2", 0, "", (sight,))
    causes = told(abort, found(Cause.ERROR_FRAMES, ""))
    assert (len(causes) == 1) is is_explained


@pytest.mark.parametrize(
    ("code", "node", "at", "is_explained"),
    [
        (0x8140, "node 2", 5 * S, True),  # recovered from bus-off, as the gap ends
        (0x8120, "node 2", 2 * S, True),  # error passive, as it begins
        (0x8140, "node 3", 5 * S, False),
        (0x8140, "node 2", 9 * S, False),
        (0x4200, "node 2", 5 * S, False),  # a temperature takes nobody off the bus
    ],
)
def test_a_node_that_says_that_it_lost_the_bus_explains_its_gap(code, node, at, is_explained):
    """Its heartbeat stays out from 2 s to 5 s."""
    beats = [
        Sight(now, Frame(0x702, b"\x05"), Service.HEARTBEAT, "", "node 2", 2)
        for now in (2 * S, 5 * S)
    ]
    lost = Finding(Cause.HEARTBEAT_LOST, "node 2", 2 * S, "", tuple(beats))
    data = code.to_bytes(2, "little") + bytes(6)
    said = Sight(at, Frame(0x082, data), Service.EMCY, "", node, 2)
    emcy = Finding(Cause.EMCY, node, at, "", (said,))
    assert (told(lost, emcy) == [(Cause.EMCY, [Cause.HEARTBEAT_LOST])]) is is_explained


def test_what_a_consequence_leads_to_is_told_with_the_cause():
    chain = (
        found(Cause.RESTART),
        found(Cause.EMCY),
        found(Cause.STATE_LEFT),
        found(Cause.PDO_MISSING),
    )
    ((cause, effects),) = told(*chain)
    assert cause is Cause.RESTART
    assert set(effects) == {Cause.EMCY, Cause.STATE_LEFT, Cause.PDO_MISSING}


@pytest.mark.parametrize("cause", Cause)
def test_every_finding_is_told_once(cause):
    """Whatever is among the findings, none gets lost and none is told twice."""
    findings = [found(each) for each in Cause] + [found(cause, "node 3")]
    causes = fewest(findings)
    everything = [*causes, *(effect for each in causes for effect in each.consequences)]
    assert sorted(each.cause.name for each in everything) == sorted(f.cause.name for f in findings)
