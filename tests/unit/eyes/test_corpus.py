"""`explain` on traffic of real stacks, and on the same with a fault that a program has put in.

The cause of a broken log is what the program did (`tests/corpus/faults*.py`), and is taken from
nothing that `explain` says. `benchmarks/eyes.py` judges the half that is kept apart.
"""

import pytest
from corpus.faults import broken_logs
from corpus.logs import is_kept_apart, manifest, sound_log

from hil_bench.abilities.eyes.explain.explain import Explainer, explain
from hil_bench.abilities.eyes.explain.live import LiveFindings

WRITTEN = sorted(name for name in manifest() if not is_kept_apart(name))
FAULTS_OF_EACH = 2


@pytest.mark.parametrize("name", WRITTEN)
def test_real_stacks_are_not_accused(name):
    log = sound_log(name)
    assert explain(log.frames, log.known(), log.bitrate).findings == ()


@pytest.mark.parametrize("name", WRITTEN)
def test_the_fault_that_was_put_in_is_the_first_finding(name):
    for broken in broken_logs(sound_log(name), FAULTS_OF_EACH):
        found = explain(broken.frames, broken.sound.known(), broken.sound.bitrate).findings
        assert found, broken.name
        assert broken.is_told_by(found[0]), (broken.name, found)


def test_the_corpus_is_as_large_as_was_promised():
    """60 sound logs and 240 broken ones; no more than a few megabytes in the repository."""
    assert len(manifest()) >= 60
    apart = sum(is_kept_apart(name) for name in manifest())
    assert 0.4 < apart / len(manifest()) < 0.6


@pytest.mark.parametrize("name", WRITTEN[::6])
def test_a_look_while_it_goes_on_changes_nothing(name):
    """Live, each half second, the verdict at the end is that of the log."""
    (broken,) = broken_logs(sound_log(name), 1)
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
