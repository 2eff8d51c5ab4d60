"""Recordings of a bench on a real bus: of one that ends, and of one that is killed."""

import signal

import pytest

from hil_bench.abilities.recording.frames import read_frames
from hil_bench.abilities.recording.reading import read_recording

NMT_START_ALL = "000#0100"
NMT = 0x000
POSITION = 0x184  # TPDO 1 of node 4, event timer 10 ms
BOOT_UPS = [0x701, 0x702, 0x703, 0x704]
END_TIMEOUT = 30.0  # for a recorder to end after its bench, however slow the machine [s]


def test_signals_and_frames_of_a_run_are_in_its_file_and_play_back(
    start_bench, start, cansend, watch, channel, tmp_path
):
    path = tmp_path / "run.mf4"
    bench = start_bench("--record", path)
    cansend(NMT_START_ALL)
    watch.wait_for(POSITION)
    ended = bench.stop()
    rows = read_recording(path)
    frames = list(read_frames(path))
    assert f"recorded  {len(rows)} rows, {len(frames)} frames: {path}" in ended.stdout
    assert f"ticks     {len(rows)} of 1000 us" in ended.stdout
    assert [f.frame.can_id for f in frames if not f.is_received][:4] == BOOT_UPS
    assert [f.frame.can_id for f in frames if f.is_received] == [NMT]
    watch.take_all()
    played = start(
        "hil-bench", "replay", path, "-i", "socketcan", "-c", channel, "--frames", "received"
    ).wait()
    assert (played.exit_code, played.stderr) == (0, "")
    assert [frame.arbitration_id for frame in watch.take_all()] == [NMT]


@pytest.mark.parametrize(("words", "received"), [([], [NMT]), (["--whole-bus"], [0x7FF, NMT])])
def test_the_kernel_keeps_foreign_frames_back_unless_the_whole_bus_is_recorded(
    start_bench, cansend, watch, tmp_path, words, received
):
    path = tmp_path / "run.mf4"
    bench = start_bench("--record", path, *words)
    cansend("7FF#01")
    cansend(NMT_START_ALL)
    watch.wait_for(POSITION)
    ended = bench.stop()
    assert f"{len(received)} received ({len(received) - 1} for nobody here)" in ended.stdout
    assert [f.frame.can_id for f in read_frames(path) if f.is_received] == received


def test_a_killed_bench_leaves_its_recorder_to_write_what_it_has(
    start_bench, cansend, watch, tmp_path
):
    path = tmp_path / "run.mf4"
    bench = start_bench("--record", path)
    cansend(NMT_START_ALL)
    watch.wait_for(POSITION)
    bench.stop(signal.SIGKILL, timeout=END_TIMEOUT)
    watch.take_all()
    sent = sum(frame.arbitration_id == POSITION for frame in watch.frames)
    recorded = sum(f.frame.can_id == POSITION for f in read_frames(path))
    assert recorded >= sent - 1  # the tick that was under way may be missing
