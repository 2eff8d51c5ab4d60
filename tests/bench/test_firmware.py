"""The example's controller in C, against the bench in lock-step on the bench's own hub.

Its own tests are run by tests/test_ci_recipes.py.
"""

import shutil

import pytest
from support.firmware import build_controller, run_session

from hil_bench.abilities.controllers.turns import Turns
from hil_bench.abilities.lockstep import firmware
from hil_bench.abilities.lockstep.firmware import HUB

pytestmark = pytest.mark.skipif(
    not (shutil.which("make") and shutil.which("cc")),
    reason="no C compiler; apt-get install make gcc libc6-dev",
)


class SeenTurns(Turns):
    """Turns that keep how many processes each was of, and how often they came to an end."""

    def __init__(self, seen):
        super().__init__()
        self._seen = seen

    def take(self, pids):
        self._seen.append(len(pids()))
        super().take(pids)

    def end(self):
        self._seen.append("end")
        super().end()


def test_two_sessions_of_two_processes_are_the_same_to_the_last_bit(tmp_path, monkeypatch):
    controller = build_controller(tmp_path)
    first = run_session(controller, HUB, "15,-5", tmp_path)
    seen = []
    monkeypatch.setattr(firmware, "Turns", lambda: SeenTurns(seen))
    again = run_session(controller, HUB, "15,-5", tmp_path)
    assert seen.count(1) > 700
    assert seen[-1] == "end"
    frames, signals = first
    assert len(frames) > 1000
    assert again[0] == frames
    assert again[1].tobytes() == signals.tobytes()
