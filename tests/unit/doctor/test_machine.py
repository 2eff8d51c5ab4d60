"""What is made of the files of the kernel, as it writes them."""

import pytest

from hil_bench.abilities.doctor import verbs
from hil_bench.abilities.doctor.machine import (
    Verdict,
    examine_machine,
    measure_lateness,
    preemption_model,
)
from hil_bench.bench.configuration import RealtimePolicy, load_config
from hil_bench.outside.realtime.clock import VirtualClock
from hil_bench.plants.hydraulic_cylinder.model.machine_code import MachineCode


def reader(**files):
    return lambda path: files.get(path.rsplit("/", 1)[1], "")


def finding(name, read):
    return next(item for item in examine_machine(read).findings if item.name == name)


@pytest.mark.parametrize(
    ("files", "model"),
    [
        # The mode in brackets, as in kernel/sched/debug.c.
        ({"preempt": "none (voluntary) full", "cmdline": "preempt=full"}, "voluntary"),
        ({"cmdline": "quiet preempt=full ro"}, "full"),
    ],
)
def test_the_preemption_model_is_that_of_now_before_that_of_the_boot(files, model):
    assert preemption_model(reader(**files)) == model


def test_a_real_time_kernel_says_so():
    assert finding("preemption", reader(realtime="1")).value == "PREEMPT_RT"


def test_a_model_that_waits_is_a_hint():
    item = finding("preemption", reader(preempt="(none) voluntary full"))
    assert (item.verdict, item.value) == (Verdict.HINT, "none")
    assert "'preempt=full'" in item.advice


@pytest.mark.parametrize(
    ("isolated", "tickless", "verdict", "advice"),
    [
        ("2-3", "2-3", Verdict.GOOD, ""),
        ("2-3", "(null)", Verdict.HINT, "'nohz_full=2-3' too, and give --realtime-cpu 2"),
        ("", "", Verdict.HINT, "'isolcpus=3 nohz_full=3', and give --realtime-cpu 3"),
    ],
)
def test_an_isolated_processor_is_there_or_told_of(
    monkeypatch, isolated, tickless, verdict, advice
):
    monkeypatch.setattr("hil_bench.abilities.doctor.machine.os.cpu_count", lambda: 4)
    item = finding("isolated processors", reader(isolated=isolated, nohz_full=tickless))
    assert item.verdict is verdict
    assert item.advice.endswith(advice)


def test_the_frequency_governor_is_judged():
    expected = {"performance": Verdict.GOOD, "powersave": Verdict.HINT, "": Verdict.ABSENT}
    assert {
        governor: finding("frequency governor", reader(scaling_governor=governor)).verdict
        for governor in expected
    } == expected


def test_a_deep_idle_state_is_a_hint():
    expected = {"2": Verdict.GOOD, "680": Verdict.HINT, "": Verdict.ABSENT}
    assert {
        latency: finding("idle states", reader(latency=latency)).verdict for latency in expected
    } == expected


def test_an_idle_state_that_is_off_does_not_count():
    read = reader(latency="680", disable="1")
    assert finding("idle states", read).verdict is Verdict.ABSENT


def test_a_slow_clock_is_a_hint():
    assert finding("clock source", reader(current_clocksource="hpet")).verdict is Verdict.HINT
    assert finding("clock source", reader(current_clocksource="tsc")).verdict is Verdict.GOOD


@pytest.mark.parametrize(
    ("count", "load", "words", "verdict"),
    [
        (None, 0.4, "0.4 on 1 processor", Verdict.GOOD),  # a system that does not count them
        (1, 0.5, "0.5 on 1 processor", Verdict.HINT),
        (4, 2.9, "2.9 on 4 processors", Verdict.GOOD),
        (4, 3.0, "3.0 on 4 processors", Verdict.HINT),
    ],
)
def test_the_load_leaves_a_processor_to_the_loop(monkeypatch, count, load, words, verdict):
    monkeypatch.setattr("os.cpu_count", lambda: count)
    monkeypatch.setattr("os.getloadavg", lambda: (load, 0.0, 0.0))
    item = finding("load", reader())
    assert (item.value, item.verdict) == (words, verdict)


def test_a_virtual_machine_is_named():
    assert "virtual machine" in finding("kernel", reader(cpuinfo="flags : fpu hypervisor")).value
    assert "virtual" not in finding("kernel", reader(cpuinfo="flags : fpu vme")).value


def test_elsewhere_the_system_is_named(monkeypatch):
    monkeypatch.setattr("hil_bench.abilities.doctor.machine.IS_LINUX", False)
    assert [item.name for item in examine_machine(reader()).findings] == ["system"]


def test_the_shortest_measurement_is_a_tick_of_each_policy():
    policies = [RealtimePolicy.OFF, RealtimePolicy.OFF]
    tests = measure_lateness(load_config(), 1e-9, policies, VirtualClock())
    assert [test.summary.ticks for test in tests] == [1, 1]


# The plant's kernel, as it was built, in the words of `hil-bench doctor`.


@pytest.mark.parametrize(
    ("code", "has_numba", "verdict", "advice"),
    [
        (MachineCode(bind=lambda *_: None), False, Verdict.GOOD, ""),
        (MachineCode(refusal="of other sources"), True, Verdict.HINT, "each start imports Numba"),
        (MachineCode(), False, Verdict.HINT, "the plant takes 57 us of a tick in place of 2"),
    ],
)
def test_a_kernel_that_costs_time_is_a_hint(monkeypatch, code, has_numba, verdict, advice):
    monkeypatch.setattr(verbs, "find_machine_code", lambda: code)
    monkeypatch.setattr(verbs, "IS_COMPILED", has_numba)
    (item,) = [each for each in verbs.examine_software().findings if each.name == "plant kernel"]
    assert item.verdict is verdict
    assert advice in item.advice
