"""When a PDO's values were measured, and how late it came, by the frames alone."""

import can
import pytest

from hil_bench.abilities.shadow.sample_clock import PdoPunctuality, SampleClock

PDO = 0x184
SYNC_PERIOD = 0.01


def frame(identifier):
    return can.Message(arbitration_id=identifier, is_extended_id=False)


def last_sample(times, *, known=False):
    """Return what is said of the last PDO at some times [s], with a SYNC each 10 ms."""
    clock = SampleClock([PDO], lambda _pdo: known)
    synced = 0.0
    sampled = None
    for time in times:
        while synced <= time:
            clock.take(frame(0x080), synced)
            synced += SYNC_PERIOD
        sampled = clock.take(frame(PDO), time)
    return sampled


def test_a_pdo_at_once_after_each_sync_was_measured_at_sync():
    sampled = last_sample([number * SYNC_PERIOD + 1e-3 for number in range(20)])
    assert sampled.likely == pytest.approx(0.19)
    assert (sampled.frame, sampled.lateness) == (pytest.approx(0.191), pytest.approx(0.0))


def test_a_pdo_that_is_known_to_be_synchronous_may_wait_for_the_bus():
    times = [number * SYNC_PERIOD + 4e-3 for number in range(20)]
    assert last_sample(times, known=True).likely == pytest.approx(0.19)
    assert last_sample(times).likely == pytest.approx(0.194)


@pytest.mark.parametrize("known", [True, False])
def test_a_second_pdo_after_one_sync_comes_by_itself(known):
    """A controller may have set it so before anybody listened."""
    times = [number * 0.004 + 1e-3 for number in range(50)]
    assert last_sample(times, known=known).likely == pytest.approx(times[-1])


def test_a_pdo_that_drifts_through_the_syncs_period_comes_by_itself():
    times = [number * 0.0107 for number in range(20)]
    assert last_sample(times).likely == pytest.approx(times[-1])


def test_a_remote_request_is_no_pdo():
    clock = SampleClock([PDO], lambda _pdo: True)
    clock.take(frame(0x080), 0.0)
    request = can.Message(arbitration_id=PDO, is_remote_frame=True, is_extended_id=False)
    assert clock.take(request, 0.001).likely == pytest.approx(0.001)


def lateness(times, syncs=()):
    """Return how late each PDO at some times came, with SYNCs at others [s]."""
    pdo = PdoPunctuality()
    found = []
    waiting = list(syncs)
    for time in times:
        while waiting and waiting[0] <= time:
            pdo.synchronise(waiting.pop(0))
        found.append(pdo.take(time))
    return found


def test_a_gap_between_regular_frames_is_lateness():
    times = [number * 0.01 for number in range(20)]
    assert lateness([*times, 0.22])[-1] == pytest.approx(0.02)


@pytest.mark.parametrize(("spread", "late"), [(0.15, 0.1), (0.25, 0.0)])
def test_intervals_within_a_fifth_of_their_median_have_a_usual_one(spread, late):
    # A third of them is the median itself, less than the 40 % that have to be alike.
    intervals = [0.1 * (1.0 - spread), 0.1, 0.1 * (1.0 + spread)] * 10
    times = [sum(intervals[:number]) for number in range(len(intervals) + 1)]
    assert lateness([*times, times[-1] + 0.2])[-1] == pytest.approx(late)


def test_an_answer_to_a_late_sync_is_not_late():
    syncs = [*(number * 0.01 for number in range(20)), 0.22]
    assert lateness([sync + 1e-3 for sync in syncs], syncs)[-1] == pytest.approx(0.0)


def test_an_answer_is_late_by_the_oldest_sync_that_waits():
    syncs = [number * 0.01 for number in range(23)]
    answers = [*(sync + 1e-3 for sync in syncs[:20]), 0.225]
    # It answers the SYNC at 0.20 s, 24 ms later than usual.
    assert lateness(answers, syncs)[-1] == pytest.approx(0.024)


def test_what_comes_at_any_time_is_never_late():
    """As a PDO that is sent when its value changes: no two intervals are alike."""
    times = [0.05 * number**2 for number in range(40)]
    assert lateness(times) == [0.0] * 40
