"""Lock-step on real SocketCAN: two processes, and the same bytes at every run."""

import subprocess
from pathlib import Path

import pytest

from hil_bench.pytest_plugin.firmware import FirmwareBus
from hil_bench.virtual_bench import VirtualBench

EXAMPLE = Path(__file__).parents[2] / "examples" / "firmware"


@pytest.fixture(scope="module")
def controller(tmp_path_factory):
    build = tmp_path_factory.mktemp("build")
    subprocess.run(["make", "--silent", "-C", EXAMPLE, f"BUILD={build}"], check=True)
    return build / "position_control"


def frames_of_a_session(controller, channel, directory):
    with VirtualBench() as bench:
        bus = FirmwareBus(bench, channel, is_realtime=False)
        try:
            command = [controller, "--bus", "{bus}", "--lockstep", "--targets-mm", "10"]
            assert bus.start(command, directory).wait(timeout=5.0) == 0
        finally:
            bus.close()
        return list(bench.frames)


def test_two_sessions_are_the_same(controller, channel, tmp_path):
    frames = frames_of_a_session(controller, channel, tmp_path)
    assert len(frames) > 1000
    assert frames_of_a_session(controller, channel, tmp_path) == frames
