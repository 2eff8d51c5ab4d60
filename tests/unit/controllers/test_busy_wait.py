"""A wait that is busy only while nobody else wants the processor; clock and yields are given."""

import os
import socket
import time

import pytest

from hil_bench.abilities.controllers.busy_wait import LONGEST_NS, MOST_SLEEPS, SHARED_NS, BusyWait


class Machine:
    """A processor: each offer of it takes a time, and behind some of them an answer is there."""

    def __init__(self, answer):
        self.now = self.offers = 0
        self.takes = 1000  # an offer [ns]
        self.answers_behind = 0
        self._answer = answer

    def offer(self):
        self.offers += 1
        self.now += self.takes
        if self.offers == self.answers_behind:
            self._answer()


@pytest.fixture
def pair():
    ours, theirs = socket.socketpair()
    with ours, theirs:
        yield ours, theirs


@pytest.fixture
def machine(pair, monkeypatch):
    made = Machine(lambda: pair[1].send(b"x"))
    monkeypatch.setattr(os, "sched_yield", made.offer)
    monkeypatch.setattr(time, "perf_counter_ns", lambda: made.now)
    return made


@pytest.fixture
def busy(pair):
    return BusyWait(pair[0].fileno())


def test_what_comes_soon_is_waited_for_each_time(pair, machine, busy):
    for answers_behind in (5, 10, 15):
        machine.answers_behind = answers_behind
        busy.wait()
        assert machine.offers == answers_behind
        assert pair[0].recv(9) == b"x"


@pytest.mark.parametrize(
    ("takes", "offers"),
    [(SHARED_NS + 1, 1), (1000, LONGEST_NS // 1000 + 1)],
    ids=["others take the processor", "nothing comes"],
)
def test_in_vain_it_sleeps_for_longer_each_time(machine, busy, takes, offers):
    machine.takes = takes
    for turn, sleeps in enumerate((1, 2, 4, 8, 16, 32, 64, MOST_SLEEPS, MOST_SLEEPS), 1):
        for _ in range(1 + sleeps):
            busy.wait()
            assert machine.offers == turn * offers


def test_what_comes_in_time_shortens_the_sleep(pair, machine, busy):
    """One in vain doubles the sleep behind the next one in vain, one in time halves it."""
    machine.takes = SHARED_NS + 1
    turns = ((False, 1), (False, 2), (True, 0), (False, 2), (True, 0), (True, 0), (False, 1))
    for is_in_time, sleeps in turns:
        before = machine.offers
        if is_in_time:
            pair[1].send(b"x")
        for _ in range(1 + sleeps):
            busy.wait()
        assert machine.offers == before + (not is_in_time)
        if is_in_time:
            assert pair[0].recv(9) == b"x"
