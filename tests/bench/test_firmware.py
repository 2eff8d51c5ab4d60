"""The example's controller in C, against the bench in lock-step on the bench's own hub.

Its own tests are run by tests/test_ci_recipes.py.
"""

import shutil
import subprocess
from pathlib import Path

import pytest

from hil_bench.pytest_plugin.firmware import HUB, FirmwareBus
from hil_bench.virtual_bench import VirtualBench

pytestmark = pytest.mark.skipif(
    not (shutil.which("make") and shutil.which("cc")),
    reason="no C compiler; apt-get install make gcc libc6-dev",
)

EXAMPLE = Path(__file__).parents[2] / "examples" / "firmware"


@pytest.fixture(scope="module")
def controller(tmp_path_factory):
    build = tmp_path_factory.mktemp("build")
    make = ["make", "--silent", "-C", EXAMPLE, f"BUILD={build}"]
    subprocess.run(make, check=True)  # noqa: S603 - our own Makefile
    return build / "position_control"


def frames_of_a_session(controller, directory):
    with VirtualBench() as bench:
        bus = FirmwareBus(bench, HUB, is_realtime=False)
        try:
            command = [controller, "--bus", "{bus}", "--lockstep", "--targets-mm", "15,-5"]
            assert bus.start(command, directory).wait(timeout=5.0) == 0
        finally:
            bus.close()
        return list(bench.frames), bench.signals


def test_two_sessions_of_two_processes_are_the_same_to_the_last_bit(controller, tmp_path):
    frames, signals = frames_of_a_session(controller, tmp_path)
    assert len(frames) > 1000
    assert frames_of_a_session(controller, tmp_path)[0] == frames
    assert frames_of_a_session(controller, tmp_path)[1].tobytes() == signals.tobytes()
