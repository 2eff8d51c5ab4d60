"""Signals that ask for the end, and a terminal that closes."""

import ctypes
import json
import operator
import os
import pty
import signal
import subprocess
import sys
import threading
from functools import partial

import pytest
from support.signals import SIGNALS

from hil_bench.abilities.recording.reading import read_recording
from hil_bench.cli.exit_codes import interrupted_once, interruption

pytestmark = pytest.mark.usefixtures("signals_that_are_heard")


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_is_a_wish(number):
    with interruption() as wish:
        assert not wish.requested
        os.kill(os.getpid(), number)
        assert wish.requested


def test_a_second_ctrl_c_does_not_wait():
    with interruption():
        os.kill(os.getpid(), signal.SIGHUP)
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)


def test_a_second_wish_of_no_signal_does_not_wait():
    with interruption() as wish:
        wish.request(signal.SIGTERM)
        wish.request(signal.SIGTERM)
        with pytest.raises(KeyboardInterrupt):
            wish.request()


def test_a_closing_terminal_asks_twice_and_is_one_wish():
    with interruption() as wish:
        for number in (signal.SIGHUP, signal.SIGHUP, signal.SIGTERM):
            os.kill(os.getpid(), number)
        assert wish.requested


@pytest.mark.parametrize("number", SIGNALS)
def test_what_closes_a_valve_is_interrupted_once(number):
    with interrupted_once():
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), number)
        for again in SIGNALS:  # while the valve is being closed
            os.kill(os.getpid(), again)


class Dying:
    """What a signal comes to while it is finalised, whose exceptions Python ignores."""

    def __init__(self, number):
        self.number = number

    def __del__(self):
        os.kill(os.getpid(), self.number)


@pytest.mark.parametrize("number", SIGNALS)
def test_an_interruption_is_not_lost_in_a_finaliser(number):
    def work():
        Dying(number)
        threading.Event().wait(5.0)

    with interrupted_once(), pytest.raises(KeyboardInterrupt):
        work()


def test_an_interruption_is_not_lost_while_it_is_asked_for_again(monkeypatch):
    """On a busy machine the signal comes before the thread that sends it has started."""

    start = threading.Thread.start

    def start_behind_the_signal(thread):
        os.kill(os.getpid(), signal.SIGINT)
        start(thread)

    def work():
        Dying(signal.SIGTERM)
        threading.Event().wait(5.0)

    monkeypatch.setattr(threading.Thread, "start", start_behind_the_signal)
    with interrupted_once(), pytest.raises(KeyboardInterrupt):
        work()


def test_a_signal_just_before_a_call_that_waits_is_not_lost():
    """Nothing of Python runs between the signal and the call, of which nothing ends."""
    come = partial(ctypes.pythonapi.PyErr_SetInterruptEx, int(signal.SIGTERM))
    end, other_end = os.pipe()
    try:
        with interrupted_once(), pytest.raises(KeyboardInterrupt):
            list(map(operator.call, [come, partial(os.read, end, 1)]))
    finally:
        os.close(end)
        os.close(other_end)


def test_another_exception_in_a_finaliser_is_shown_as_before(monkeypatch):
    shown = []
    monkeypatch.setattr(sys, "unraisablehook", shown.append)
    with interrupted_once():
        Dying("no number")
    assert [each.exc_type for each in shown] == [TypeError]
    assert sys.unraisablehook == shown.append


def test_the_handlers_of_before_come_back():
    before = [signal.getsignal(number) for number in SIGNALS]
    with interruption(), interrupted_once():
        pass
    assert [signal.getsignal(number) for number in SIGNALS] == before


def test_nohup_stays_in_force():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with interruption() as wish:
            os.kill(os.getpid(), signal.SIGHUP)
            assert not wish.requested
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("number", SIGNALS[:2])
def test_a_verb_without_a_loop_ends_in_order_too(tmp_path, number):
    """It waits for the other end of its file, so that the signal comes while it works."""
    log = tmp_path / "pipe.log"
    os.mkfifo(log)
    words = [sys.executable, "-m", "hil_bench", "explain", str(log)]
    program = subprocess.Popen(words, stderr=subprocess.PIPE)  # noqa: S603 - our own program
    with program, log.open("w"):  # once the program has opened it
        program.send_signal(number)
        said = program.stderr.read()
    assert (program.returncode, said) == (130, b"")


RUN_ON_A_TERMINAL = """
import os, pty, signal, sys
pid, master = pty.fork()
if not pid:
    os.execv(sys.executable, [sys.executable, "-m", "hil_bench", *sys.argv[1:]])
text = b""
while b"overran" not in text:  # of the status lines
    text += os.read(master, 4096)
os.close(master)  # and the kernel sends SIGHUP
os.killpg(pid, signal.SIGHUP)  # as the shell does, to all on this terminal
print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
"""


@pytest.mark.long  # a whole run on a terminal of its own
@pytest.mark.skipif(not hasattr(pty, "fork"), reason="needs a pseudo-terminal")
def test_a_terminal_that_closes_leaves_the_whole_recording(tmp_path):
    """The recorder and the status lines are on that terminal, too."""
    path = tmp_path / "run.csv"
    timing = tmp_path / "timing.json"
    words = ["run", "-i", "virtual", "-c", "x", "--record", str(path), "--histograms", str(timing)]
    ended = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-c", RUN_ON_A_TERMINAL, *words],
        capture_output=True,
        text=True,
        check=True,
    )
    assert ended.stdout == "130\n"
    times = read_recording(path)["time"]
    assert len(times) == json.loads(timing.read_text())["ticks"]
