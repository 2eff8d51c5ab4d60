"""The calls themselves, on the Linux that runs the tests; what they do is asked of the kernel."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from hil_bench.outside.realtime import linux

SPINNING = """
import resource, signal
from hil_bench.outside.realtime import linux
lift = linux.limit_spinning(1.0, 5.0)
print(resource.getrlimit(resource.RLIMIT_RTTIME))
lift()
print(resource.getrlimit(resource.RLIMIT_RTTIME)[0] != 1_000_000)
"""


def test_the_timer_slack_is_what_was_set():
    before = linux.timer_slack()
    linux.set_timer_slack(12_345)
    try:
        assert linux.timer_slack() == 12_345
        # proc(5): the slack of the thread group's leader, which runs this test.
        assert int(Path("/proc/self/timerslack_ns").read_text()) == 12_345
    finally:
        linux.set_timer_slack(before)


def test_spinning_is_limited_by_the_kernel():
    """In a process of its own, since a hard limit cannot be raised again without permission."""
    command = [sys.executable, "-c", SPINNING]
    result = subprocess.run(  # noqa: S603 - this Python
        command, capture_output=True, text=True, check=True
    )
    assert result.stdout == "(1000000, 5000000)\nTrue\n"


def test_the_wake_up_latency_is_held_while_its_file_is_open(tmp_path, monkeypatch):
    """A latency is 32 bits in the machine's order (pm_qos_interface.rst); 0 us."""
    place = tmp_path / "cpu_dma_latency"
    place.touch()
    monkeypatch.setattr(linux, "WAKE_LATENCY", place)
    assert linux.may_hold_wake_latency()
    release = linux.hold_wake_latency()
    opened = [each.resolve() for each in Path("/proc/self/fd").iterdir()]
    assert opened.count(place) == 1
    release()
    assert place not in [each.resolve() for each in Path("/proc/self/fd").iterdir()]
    assert place.read_bytes() == b"\0\0\0\0"


def test_a_wake_up_latency_that_cannot_be_held(tmp_path, monkeypatch):
    monkeypatch.setattr(linux, "WAKE_LATENCY", tmp_path / "cpu_dma_latency")
    assert not linux.may_hold_wake_latency()
    with pytest.raises(FileNotFoundError):
        linux.hold_wake_latency()
    assert not list(tmp_path.iterdir())  # a file of that name holds no processor awake


def test_access_alone_does_not_permit_the_wake_up_latency(tmp_path, monkeypatch):
    """As a folder, which may be written and not opened; a container refuses a device likewise."""
    monkeypatch.setattr(linux, "WAKE_LATENCY", tmp_path)
    assert not linux.may_hold_wake_latency()


def test_a_call_that_the_kernel_refuses_says_why():
    with pytest.raises(OSError, match="Invalid argument"):
        linux.set_deadline_policy(runtime=2_000_000, period=1_000_000)  # more than there is


@pytest.mark.parametrize(
    "call",
    [
        linux.timer_slack,
        linux.hold_wake_latency,
        linux.lock_memory,
        linux.processors,
        linux.policy_restorer,
        linux.memory_limit,
        lambda: linux.set_fifo_policy(1),
        lambda: linux.limit_spinning(1, 2),
    ],
)
def test_elsewhere_there_is_nothing_of_it(monkeypatch, call):
    monkeypatch.setattr("hil_bench.outside.realtime.linux.sys.platform", "darwin")
    with pytest.raises(OSError, match="Function not implemented"):
        call()


def test_a_thread_gets_the_policy_back_that_it_had(monkeypatch):
    """What the kernel is asked, for to try it takes permission.

    sched(7): who has none may not take SCHED_RESET_ON_FORK back, so it stays.
    """
    asked = []
    monkeypatch.setattr(os, "sched_getscheduler", lambda _thread: os.SCHED_BATCH)
    monkeypatch.setattr(os, "sched_getparam", lambda _thread: os.sched_param(0))
    monkeypatch.setattr(os, "sched_setscheduler", lambda *arguments: asked.append(arguments))
    restore = linux.policy_restorer()
    linux.set_fifo_policy(70)
    restore()
    linux.set_normal_policy()
    assert asked == [
        (0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(70)),
        (0, os.SCHED_BATCH | os.SCHED_RESET_ON_FORK, os.sched_param(0)),
        (0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0)),
    ]
