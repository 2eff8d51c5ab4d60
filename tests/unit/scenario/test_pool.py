"""Tasks in processes of their own: here of processes that are played, on a clock that is played."""

from typing import NamedTuple

import pytest

from hil_bench.abilities.scenario import pool
from hil_bench.abilities.scenario.pool import Pool, TaskEnd
from hil_bench.errors import ConfigError


class Spec(NamedTuple):
    """A task: seconds that a process takes for it, or how it fails."""

    does: float | type[EOFError] | str
    timeout: float = 1.0


class Process:
    """Starts in 100 s, and then does each task in its time."""

    clock, waits, pid = 0.0, [], None

    def __init__(self, *_, **_more):
        self.answers = [(self.clock + 100.0, None)]
        self.alive = True

    def start(self):
        self.alive = True

    def fileno(self):
        return 0

    def send(self, spec):
        begins = max([self.clock, *(time for time, _ in self.answers)])
        takes = spec.does if isinstance(spec.does, float) else 0.0
        self.answers.append((begins + takes, f"no file {spec.does}" if spec.does == "x" else spec))

    def receive(self, _timeout):
        if not self.answers or self.answers[0][0] > self.clock:
            raise TimeoutError
        answer = self.answers.pop(0)[1]
        if isinstance(answer, Spec) and answer.does is EOFError:
            raise EOFError
        return answer

    def ending(self):
        return "was killed (SIGKILL)"

    def stop(self, _timeout):
        self.alive = False


def wait(_ready, timeout):
    Process.waits.append(timeout)
    assert len(Process.waits) < 1000, "it does not sleep"
    Process.clock += timeout


def done(monkeypatch, *specs, jobs=1):
    monkeypatch.setattr(pool, "HelperProcess", Process)
    monkeypatch.setattr(pool, "wait", wait)
    monkeypatch.setattr(pool, "monotonic", lambda: Process.clock)
    Process.clock, Process.waits = 0.0, []
    with Pool(jobs, None, lambda spec, end, why: (spec.does, end, why)) as workers:
        return list(workers(specs))


def test_it_sleeps_while_others_work_and_looks_each_half_second(monkeypatch):
    assert done(monkeypatch, Spec(0.75), Spec(0.25)) == [Spec(0.75), Spec(0.25)]
    assert Process.clock == pytest.approx(101.0, abs=0.5)
    assert max(Process.waits) <= 0.5


def test_what_is_done_first_comes_first(monkeypatch):
    assert done(monkeypatch, Spec(0.9), Spec(0.3), jobs=2) == [Spec(0.3), Spec(0.9)]


def test_a_task_that_takes_too_long_or_dies_is_a_result_and_the_next_is_done(monkeypatch):
    """The time of the first begins when the process has started, which may take 100 s."""
    slow, dead = Spec(3.0, 2.0), Spec(EOFError)
    assert done(monkeypatch, Spec(0.5), slow, Spec(0.5), dead, Spec(0.25)) == [
        Spec(0.5),
        (3.0, TaskEnd.TIMED_OUT, "has taken more than 2 s"),
        Spec(0.5),
        (EOFError, TaskEnd.CRASHED, "its process was killed (SIGKILL)"),
        Spec(0.25),
    ]


def test_files_that_are_wrong_end_all(monkeypatch):
    with pytest.raises(ConfigError, match="no file x"):
        done(monkeypatch, Spec(0.5), Spec("x"), Spec(0.5))
