"""Logs that are odd themselves: clocks that jump, two logs in one, frames of others between."""

import pytest
from corpus.faults import sender
from corpus.logs import sound_log

from device_profiles import VALVE_408
from hil_bench.abilities.eyes.explain.explain import Clock, explain
from hil_bench.abilities.eyes.explain.finding import Cause
from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import LoggedFrame

S = 1_000_000_000
MS = 1_000_000


def own():
    return list(sound_log("own_event").frames)


def judged(frames):
    return explain(frames, sound_log("own_event").known(), 1_000_000)


def test_a_clock_that_is_set_back_is_a_line():
    frames = own()
    half = len(frames) // 2
    back = [each._replace(now=each.now - 3600 * S) for each in frames[half:]]
    found = judged(frames[:half] + back)
    at = frames[half - 1].now / S
    assert found.notes[0].startswith(f"the clock goes back at {at:.3f} s")
    assert found.findings == ()


def test_a_clock_that_leaps_on_is_a_line():
    frames = own()
    half = len(frames) // 2
    late = [each._replace(now=each.now + 7200 * S) for each in frames[half:]]
    found = judged(frames[:half] + late)
    before = frames[half - 1].now
    leap = f"by {(late[0].now - before) / S:.3f} s at {before / S:.3f} s"
    assert found.notes == (f"the clock leaps {leap}, or nothing was recorded",)
    assert found.findings == ()


def test_the_frames_of_a_second_log_between_are_left_out():
    """Ten frames of yesterday after each hundred."""
    frames = []
    for number, each in enumerate(own()):
        frames.append(each)
        if number % 100 == 99:
            strange = Frame(0x703, b"\0")
            frames += [LoggedFrame(strange, each.now - 86_400 * S, None)] * 10
    found = judged(frames)
    left_out = len(frames) - len(own())
    assert found.notes == (
        f"{left_out} frames of an earlier time, as of a second log, are left out",
    )
    assert found.findings == ()


@pytest.mark.parametrize("name", ["pycanopen_canopennode_event_pdo", "lely_lely_two", "own_event"])
@pytest.mark.parametrize("distance", [40_000, 13_100_000, 37_000_000])
def test_two_recordings_of_one_bus_in_one_log_are_one_finding(name, distance):
    """Each frame comes again after a distance, the clocks being apart by it."""
    log = sound_log(name)
    again = [each._replace(now=each.now + distance) for each in log.frames]
    frames = sorted([*log.frames, *again], key=lambda each: each.now)
    (found,) = explain(frames, log.known(), log.bitrate).findings
    assert found.cause is Cause.TWO_RECORDINGS


def test_a_second_device_of_one_node_id_is_no_second_recording():
    """Its frames come twice; those of the master and of the other node do not."""
    log = sound_log("lely_lely_two")
    again = [each._replace(now=each.now + 13 * MS) for each in log.frames if sender(each) == 2]
    frames = sorted([*log.frames, *again], key=lambda each: each.now)
    assert explain(frames, log.known(), log.bitrate).findings[0].cause is Cause.NODE_ID_CLASH


def test_who_boots_after_a_leap_has_not_restarted_by_itself():
    """Two days of one network in one log: the second begins with its boot-up messages."""
    log = sound_log("pycanopen_canopennode_event_pdo")
    again = [each._replace(now=each.now + 86_400 * S) for each in log.frames]
    found = explain([*log.frames, *again], log.known(), log.bitrate)
    assert found.findings == ()
    assert len(found.notes) == 1


def test_an_eds_of_another_device_is_one_finding():
    log = sound_log("lely_lely_two")
    known = [KnownNode(2, "", load_eds(VALVE_408, 2))]
    (found,) = explain(log.frames, known, log.bitrate).findings
    assert found.cause is Cause.OTHER_DEVICE
    assert "0x1000.00" in found.text
    assert "0x1018.02" in found.text


def test_a_time_never_goes_back():
    """The first is 0; 5 ms back are as the last was."""
    clock = Clock()
    times = [clock.time_of(S + each * MS) for each in (0, 7, 3, 9)]
    assert times == [(each * MS, 0) for each in (0, 7, 7, 9)]


def test_frames_that_are_written_out_of_order_are_no_matter():
    frames = own()
    for place in range(50, len(frames) - 1, 50):
        frames[place], frames[place + 1] = frames[place + 1], frames[place]
    assert judged(frames).findings == ()


def test_a_cut_log_is_judged_as_far_as_it_goes():
    frames = own()
    for begin, end in ((0, 40), (40, 400), (400, len(frames))):
        assert judged(frames[begin:end]).findings == ()


def test_frames_of_29_bits_between_are_no_matter():
    frames = []
    for each in own():
        frames += [each, LoggedFrame(Frame(0x1234567, b"\1\2", is_extended=True), each.now, None)]
    assert judged(frames).findings == ()
