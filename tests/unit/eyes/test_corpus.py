"""`explain` on traffic of real stacks, and on the same with a fault that a program has put in.

The cause of a broken log is what the program did (`tests/corpus/faults*.py`), and is taken from
nothing that `explain` says. `benchmarks/eyes.py` judges the half that is kept apart.
"""

from itertools import islice

import pytest
from corpus.faults import broken_log, broken_logs, faults, faults_of_j1939
from corpus.logs import is_kept_apart, manifest, sound_log
from corpus.sound_j1939 import VARIANTS, variant_of

from hil_bench.abilities.eyes.explain.explain import Explainer, LiveFindings, explain

WRITTEN = sorted(name for name in manifest() if not is_kept_apart(name))
OF_J1939 = [name for name in WRITTEN if manifest()[name].get("series")]
FAULTS_OF_EACH = 2
UNDECIDED = {
    "canopend_gateway_lss:node_absent",  # asked once, by one SDO request, and never again
    "canj1939_lever_on_change:message_stays_out",  # of a lever that is sent at changes alone
    "canj1939_three_bams:two_devices_vanish_together",  # of three that send once a second
    "canj1939_long_both_ways:transfer_aborted",  # one group to and fro: the abort names no message
}


def length(name):
    return len(sound_log(name).frames)


@pytest.mark.parametrize("name", WRITTEN)
def test_real_stacks_are_not_accused(name):
    log = sound_log(name)
    assert explain(log.frames, log.known(), log.bitrate).findings == ()


@pytest.mark.parametrize("name", WRITTEN)
def test_the_fault_that_was_put_in_is_the_first_finding(name):
    for broken in broken_logs(sound_log(name), FAULTS_OF_EACH, FAULTS_OF_EACH):
        if broken.name in UNDECIDED:
            continue
        found = explain(broken.frames, broken.sound.known(), broken.sound.bitrate).findings
        assert found, broken.name
        assert broken.is_told_by(found[0]), (broken.name, found)


@pytest.mark.parametrize("variant", sorted(VARIANTS))
def test_what_is_usual_on_j1939_is_not_accused(variant):
    """A log begins late, a device joins, a tool signs off: each in two of the logs."""
    fitting = filter(None, (variant_of(sound_log(name), variant) for name in OF_J1939))
    for log in islice(fitting, 2):
        assert explain(log.frames, log.known(), log.bitrate).findings == (), log.name


@pytest.mark.parametrize("fault", sorted({**faults(), **faults_of_j1939()}))
def test_each_fault_is_found_first_where_it_fits_first(fault):
    """The draw of the test above may leave some out. In the shortest log that fits."""
    among = OF_J1939 if fault in faults_of_j1939() else WRITTEN
    for name in (*sorted(among, key=length), *sorted(manifest())):
        broken = broken_log(sound_log(name), fault)
        if broken is not None and broken.name not in UNDECIDED:
            found = explain(broken.frames, broken.sound.known(), broken.sound.bitrate).findings
            assert found, broken.name
            assert broken.is_told_by(found[0]), (broken.name, found)
            return
    pytest.fail("no log has what the fault befalls")


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("pycanopen_lely_rtr_pdo", "bus_is_cut"),
        ("lely_canopennode_heartbeat", "reset_and_forgotten"),
        ("pycanopen_canopennode_ring", "pdo_too_long"),
        ("pycanopen_canopennode_four_tpdos", "pdo_without_timer_falls_silent"),
        ("canopend_gateway_sync", "sync_jitters"),
        ("kernelj1939_claims_and_cyclic", "message_stays_out"),
        ("canj1939_beside_canopen", "message_stays_out"),
        ("canj1939_bam", "ecu_falls_silent"),
        ("kernelj1939_slow", "trouble_code"),
        ("hilbench_lever_traffic", "device_of_another_name_at_an_address"),
    ],
)
def test_what_was_missed_at_first_sight_is_found(name, fault):
    """Each showed a fault of `explain` that others have, too (docs/benchmarks.md)."""
    broken = broken_log(sound_log(name), fault)
    assert broken is not None
    found = explain(broken.frames, broken.sound.known(), broken.sound.bitrate).findings
    assert broken.is_told_by(found[0]), found


def test_the_corpus_is_as_large_as_was_promised():
    """60 sound logs and 240 broken ones; no more than a few megabytes in the repository."""
    assert len(manifest()) >= 60
    apart = sum(is_kept_apart(name) for name in manifest())
    assert 0.4 < apart / len(manifest()) < 0.6


@pytest.mark.parametrize("name", WRITTEN[::6])
def test_a_look_while_it_goes_on_changes_nothing(name):
    """Live, each half second, the verdict at the end is that of the log."""
    (broken,) = broken_logs(sound_log(name), 1, 0)
    explainer = Explainer(broken.sound.known(), broken.sound.bitrate)
    live = LiveFindings(explainer)
    came = set()
    for logged in broken.frames:
        explainer.take(logged)
        came |= {change.finding.cause for change in live.look(explainer.now)}
    at_end = explain(broken.frames, broken.sound.known(), broken.sound.bitrate)
    assert explainer.finish() == at_end
    if live.findings:
        assert {each.cause for each in live.findings} <= came


def test_the_same_log_gives_the_same_broken_ones():
    log = sound_log(WRITTEN[0])
    once, again = ([each.frames for each in broken_logs(log, 3)] for _ in range(2))
    assert once == again
