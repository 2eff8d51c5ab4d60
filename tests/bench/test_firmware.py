"""The example's controller in C, against the bench in lock-step on the bench's own hub.

Its own tests are run by tests/test_ci_recipes.py.
"""

import shutil

import pytest
from support.firmware import build_controller, run_session

from hil_bench.abilities.lockstep.firmware import HUB

pytestmark = pytest.mark.skipif(
    not (shutil.which("make") and shutil.which("cc")),
    reason="no C compiler; apt-get install make gcc libc6-dev",
)


def test_two_sessions_of_two_processes_are_the_same_to_the_last_bit(tmp_path):
    controller = build_controller(tmp_path)
    first, again = (run_session(controller, HUB, "15,-5", tmp_path) for _ in range(2))
    frames, signals = first
    assert len(frames) > 1000
    assert again[0] == frames
    assert again[1].tobytes() == signals.tobytes()
