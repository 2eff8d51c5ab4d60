"""Processes that take turns stay on one processor, but for one turn in `PERIOD`."""

import os
import subprocess
import sys
import threading

import pytest

from hil_bench.abilities.controllers import turns
from hil_bench.abilities.controllers.turns import PERIOD, Turns

ALL = {0, 1, 2, 3}
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="threads are tied on Linux only")


@pytest.fixture
def machine(monkeypatch):
    """Processors 0 to 3, of which this thread runs on 2; where each thread may run."""
    places = {}
    monkeypatch.setattr(turns.linux, "processor", lambda: 2)
    monkeypatch.setattr(os, "sched_getaffinity", lambda thread: places.get(thread, ALL))
    monkeypatch.setattr(os, "sched_setaffinity", places.__setitem__)
    return places


@pytest.fixture
def process():
    with subprocess.Popen(["/bin/sleep", "60"]) as running:
        yield running.pid
        running.kill()


def play(count, *pids, of=None):
    played = of or Turns()
    for _ in range(count):
        played.take(lambda: pids)
    return played


def test_both_are_tied_behind_the_start_and_free_for_one_turn(machine, process):
    own = threading.get_native_id()
    played = play(PERIOD - 1, process)
    assert machine == {}
    play(1, process, of=played)
    assert machine == {own: {2}, process: {2}}
    play(PERIOD - 1, process, of=played)
    assert machine == {own: ALL, process: ALL}
    play(1, process, of=played)
    assert machine == {own: {2}, process: {2}}
    played.end()
    assert machine == {own: ALL, process: ALL}


def test_a_process_with_two_threads_is_left_alone(machine):
    over = threading.Event()
    second = threading.Thread(target=over.wait)
    second.start()
    play(PERIOD, os.getpid()).end()
    over.set()
    second.join()
    assert machine == {}


@pytest.mark.parametrize("places", [{2}, {0, 1}])
def test_a_process_that_may_not_run_elsewhere_or_here_stays_as_it_is(machine, process, places):
    machine[process] = places
    play(PERIOD, process).end()
    assert machine[process] == places


def test_who_ties_itself_meanwhile_stays_so(machine, process):
    played = play(PERIOD, process)
    machine[process] = {3}
    played.end()
    assert machine[process] == {3}


def test_threads_that_they_have_started_meanwhile_are_free_again(machine, process, monkeypatch):
    played = play(PERIOD, process)
    machine[77] = {2}  # inherited
    monkeypatch.setattr(turns.linux, "threads", lambda thread: [thread, 77])
    played.end()
    assert machine[77] == ALL


def test_where_the_kernel_refuses_or_a_process_has_ended_all_goes_on(machine, process, monkeypatch):
    def refuse(*_):
        raise PermissionError

    monkeypatch.setattr(os, "sched_setaffinity", refuse)
    play(2 * PERIOD, process, 0).end()
    assert machine == {}
