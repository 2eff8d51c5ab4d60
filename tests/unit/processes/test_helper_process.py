"""Processes that share the terminal: what they do not hear, and how they are said to have ended."""

import os
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from hil_bench.outside.helper_process import HelperProcess, start_shielded
from hil_bench.outside.signals import ENDING

needs_linux = pytest.mark.skipif(sys.platform != "linux", reason="reads masks from /proc")


def wait_for_the_end(connection):
    connection.poll(None)


def fail(connection):
    connection.send("begun")
    raise ValueError("this\nis wrong")


def leave(_connection):
    sys.exit(7)


def join(helper):
    helper._process.join()
    return helper.ending()


@needs_linux
def test_signals_of_a_terminal_are_blocked_from_the_first_moment_on():
    helper = HelperProcess(wait_for_the_end, (), name="test")
    helper.start()
    status = Path(f"/proc/{helper.pid}/status").read_text(encoding="ascii")
    helper.stop(30)
    blocked = int(re.search(r"^SigBlk:\s*([0-9a-f]+)$", status, re.MULTILINE)[1], base=16)
    for number in ENDING:
        assert blocked & 1 << (number - 1)  # proc(5): bit 0 is signal 1
        assert number not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def test_a_signal_that_another_thread_takes_waits_until_the_start_is_done():
    """NumPy's BLAS has threads on every machine with several processors; they block nothing."""
    begun, done = threading.Event(), []

    def interrupt():
        begun.wait()
        os.kill(os.getpid(), signal.SIGINT)

    class Starting:
        def start(self):
            begun.set()
            thread.join()
            done.append(True)

    thread = threading.Thread(target=interrupt)
    thread.start()
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            start_shielded(Starting())
        assert done
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


def test_it_ends_when_it_is_let_go_of():
    helper = HelperProcess(wait_for_the_end, (), name="test")
    assert not helper.alive
    helper.start()
    assert helper.alive
    assert helper.ending() is None
    with pytest.raises(TimeoutError):
        helper.receive(0)
    helper.stop(30)
    assert not helper.alive
    assert helper.ending() == "ended with exit code 0"


def test_one_that_was_killed_says_by_which_signal():
    helper = HelperProcess(wait_for_the_end, (), name="test")
    helper.start()
    os.kill(helper.pid, signal.SIGKILL)
    assert join(helper) == "was killed (SIGKILL, by somebody or for want of memory)"
    helper.send("nobody listens")
    with pytest.raises(EOFError):
        helper.receive(0)


def test_an_exception_is_a_line_and_no_traceback_on_the_terminal(capfd):
    helper = HelperProcess(fail, (), name="test")
    helper.start()
    assert helper.receive(30) == "begun"
    assert join(helper) == "ended by an error of hil-bench (ValueError: this is wrong)"
    assert 'raise ValueError("this\\nis wrong")' in helper.trace
    assert capfd.readouterr().err == ""


def answer_nobody(connection):
    connection.poll(None)
    connection.send("too late")


def test_one_whose_parent_let_go_of_it_says_nothing_on_the_terminal(capfd):
    helper = HelperProcess(answer_nobody, (), name="test")
    helper.start()
    helper.stop(30)
    assert helper.ending() == "ended with exit code 1"
    assert capfd.readouterr().err == ""


def test_one_that_leaves_says_its_exit_code():
    helper = HelperProcess(leave, (), name="test")
    helper.start()
    assert join(helper) == "ended with exit code 7"
    assert helper.trace == ""


def test_one_that_hangs_is_killed():
    helper = HelperProcess(hang, (), name="test")
    helper.start()
    assert helper.receive(30) == "begun"
    helper.stop(0.01)
    assert helper.ending() == "was killed (SIGKILL, by somebody or for want of memory)"


def hang(connection):
    connection.send("begun")
    while True:
        signal.pause()


FORGETFUL = """
import sys
sys.path.insert(0, sys.argv[1])
from test_helper_process import HelperProcess, wait_for_the_end
if __name__ == "__main__":
    helper = HelperProcess(wait_for_the_end, (), name="test")
    helper.start()
"""


def test_a_program_that_lets_go_of_none_ends(make_file):
    script = make_file("forgetful.py", FORGETFUL)
    command = [sys.executable, str(script), str(Path(__file__).parent)]
    assert subprocess.run(command, check=False).returncode == 0  # noqa: S603
