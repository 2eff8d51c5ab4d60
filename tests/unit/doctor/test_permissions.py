"""What the kernel permits; it is a double, for each machine permits something else."""

import errno

import pytest

from hil_bench.abilities.doctor.machine import Verdict, examine_permissions


class Kernel:
    """Refuses the calls in `refused`; what it may, it is asked by name."""

    def __init__(self, *refused):
        self.refused = refused

    def __getattr__(self, name):
        def call(*_arguments):
            if name.startswith("may_"):
                return name not in self.refused
            if name in self.refused:
                raise OSError(errno.EPERM, "Operation not permitted")
            known = {"timer_slack": 50_000, "processors": {0, 1}, "priority_limit": 95}
            return known.get(name, 8 * 2**20)

        return call


@pytest.fixture
def examine(monkeypatch):
    def examine_with(*refused, runtime="950000", may_lock=True, has_capability=False, count=2):
        monkeypatch.setattr("hil_bench.abilities.doctor.machine.os.cpu_count", lambda: count)
        monkeypatch.setattr("hil_bench.abilities.doctor.machine.linux", Kernel(*refused))
        place = "hil_bench.outside.realtime.scheduling."
        monkeypatch.setattr(place + "may_lock_memory", lambda: may_lock)
        monkeypatch.setattr(place + "has_capability", lambda _number: has_capability)
        topic = examine_permissions(lambda _path: runtime)
        return {item.name: item for item in topic.findings}

    return examine_with


def test_what_is_permitted_is_good(examine):
    found = examine()
    assert {item.verdict for item in found.values()} == {Verdict.GOOD}
    assert found["SCHED_FIFO"].value == "permitted; RLIMIT_RTPRIO 95"
    assert found["memory lock"].value == "permitted; RLIMIT_MEMLOCK 8 MiB"
    assert found["wake-up latency"].value == "may be held at 0 us, as a run with --realtime does"
    assert found["real-time throttling"].value == "95 % for real-time threads"
    assert found["processors"].value == "0-1 permitted"


def test_what_is_refused_says_what_to_grant(examine):
    refused = ("set_fifo_policy", "set_deadline_policy", "may_hold_wake_latency")
    found = examine(*refused, may_lock=False)
    for name, grant in (
        ("SCHED_FIFO", "CAP_SYS_NICE"),
        ("SCHED_DEADLINE", "CAP_SYS_NICE"),
        ("memory lock", "CAP_IPC_LOCK"),
        ("wake-up latency", "/dev/cpu_dma_latency"),
    ):
        assert found[name].verdict is Verdict.HINT
        assert grant in found[name].advice


def test_a_refusal_in_spite_of_the_capability_is_the_cgroups(examine):
    found = examine("set_fifo_policy", has_capability=True)
    assert "cpu.rt_runtime_us" in found["SCHED_FIFO"].advice


def test_a_deadline_that_is_refused_on_some_processors_is_not_the_cgroups(examine):
    """sched(7): EPERM, too, where the affinity leaves out a processor of the root domain."""
    refused = ("set_fifo_policy", "set_deadline_policy")
    found = examine(*refused, has_capability=True, count=4)  # the process may use two
    assert "taskset" in found["SCHED_DEADLINE"].advice
    assert "cpu.rt_runtime_us" in found["SCHED_FIFO"].advice
    assert "cpu.rt_runtime_us" in examine(*refused, has_capability=True)["SCHED_DEADLINE"].advice


def test_throttling_that_is_off_is_a_risk(examine):
    assert examine(runtime="-1")["real-time throttling"].verdict is Verdict.HINT
    assert examine(runtime="")["real-time throttling"].verdict is Verdict.ABSENT


def test_no_time_for_real_time_threads_is_no_good_machine(examine):
    """0 us of each second: the kernel runs no thread of a real-time policy at all."""
    found = examine(runtime="0")["real-time throttling"]
    assert (found.verdict, found.value) == (Verdict.HINT, "no time at all for real-time threads")


def test_elsewhere_nothing_is_asked(monkeypatch):
    monkeypatch.setattr("hil_bench.abilities.doctor.machine.IS_LINUX", False)
    topic = examine_permissions(lambda _path: "")
    assert {item.verdict for item in topic.findings} == {Verdict.ABSENT}
