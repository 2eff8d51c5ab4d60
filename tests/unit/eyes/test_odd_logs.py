"""Logs that are odd themselves: clocks that jump, two logs in one, frames of others between."""

from corpus.logs import sound_log

from hil_bench.abilities.eyes.explain.explain import explain
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.logged_frame import LoggedFrame

S = 1_000_000_000


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
