"""The recording of a machine's network, beside what works on it."""

from types import SimpleNamespace

import can

from hil_bench.abilities.common.controller_side import OpenNetwork
from hil_bench.abilities.recording.frames import read_frames
from hil_bench.abilities.recording.reading import read_recording
from hil_bench.abilities.recording.work import recorded_work
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import Channel


def test_frames_and_samples_share_one_time_base_that_begins_with_the_recording(tmp_path):
    """The network's clock shows 5 s by then; a frame 1.5 s later is recorded at 1.5 s."""
    times = [5.0]
    network = SimpleNamespace(now=lambda: times[-1], observe=None)
    opened = OpenNetwork(network, "virtual", None, is_stepped=True)
    path = tmp_path / "work.mf4"
    with recorded_work(path, opened, (Channel("axis1.P_A", "Pa"),), "a test") as (sink, origin):
        times.append(6.5)
        network.observe(can.Message(arbitration_id=0x181, data=b"\1", is_extended_id=False))
        sink.append_row((times[-1] - origin, 2e5))
        sent = can.Message(arbitration_id=0x201, data=b"", is_extended_id=False, is_rx=False)
        network.observe(sent)
    assert network.observe is None
    found = [(each.frame, each.now, each.is_received) for each in read_frames(path)]
    assert found == [
        (Frame(0x181, b"\1"), 1_500_000_000, True),
        (Frame(0x201, b""), 1_500_000_000, False),
    ]
    assert read_recording(path).tolist() == [(1.5, 2e5)]


def test_work_that_fails_leaves_what_was_recorded(tmp_path):
    network = SimpleNamespace(now=lambda: 0.0, observe=None)
    opened = OpenNetwork(network, "virtual", None, is_stepped=True)
    path = tmp_path / "work.csv"
    work = recorded_work(path, opened, (Channel("axis1.P_A", "Pa"),), "a test")
    sink, _ = work.__enter__()
    sink.append_row((0.0, 2e5))
    assert not work.__exit__(RuntimeError, RuntimeError("a leak"), None)
    assert network.observe is None
    assert read_recording(path).tolist() == [(0.0, 2e5)]
