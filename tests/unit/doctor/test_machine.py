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
    """Return a reader of files of these names, of each folder that ends as a name with / does."""
    return lambda path: next((files[end] for end in files if path.endswith(f"/{end}")), "")


def finding(name, read):
    return next(item for item in examine_machine(read).findings if item.name == name)


@pytest.mark.parametrize(
    ("files", "model"),
    [
        # The mode in brackets, as in kernel/sched/debug.c.
        ({"preempt": "none (voluntary) full", "cmdline": "preempt=full"}, "voluntary"),
        ({"cmdline": "quiet preempt=full ro"}, "full"),
        # As kernel/Kconfig.preempt names them.
        ({"config-6.1": "CONFIG_PREEMPT_BUILD=y\nCONFIG_PREEMPT_LAZY=y"}, "lazy"),
        ({"config-6.1": "# CONFIG_PREEMPT_NONE is not set\nCONFIG_PREEMPT=y"}, "full"),
        ({"config-6.1": "CONFIG_PREEMPT_COUNT=y"}, ""),
    ],
)
def test_the_preemption_model_is_that_of_now_before_that_of_the_boot_and_of_the_build(
    monkeypatch, files, model
):
    monkeypatch.setattr("platform.release", lambda: "6.1")
    monkeypatch.setattr("hil_bench.abilities.doctor.machine.Path.read_bytes", _refuse)
    assert preemption_model(reader(**files)) == model


def _refuse(_path):
    raise FileNotFoundError


STATES = "none that the kernel chooses"
DEEPEST = "the deepest takes {} us to wake from".format


@pytest.mark.parametrize(
    ("name", "files", "verdict", "value"),
    [
        ("preemption", {"realtime": "1"}, Verdict.GOOD, "PREEMPT_RT"),
        ("preemption", {"preempt": "(none) voluntary full"}, Verdict.HINT, "none"),
        ("frequency governor", {"scaling_governor": "performance"}, Verdict.GOOD, "performance"),
        ("frequency governor", {"scaling_governor": "powersave"}, Verdict.HINT, "powersave"),
        (
            "frequency governor",
            {},
            Verdict.ABSENT,
            "none: the frequency is not the kernel's to choose",
        ),
        # A twentieth of a tick of 1 ms is usual; CPUIDLE_STATE_MAX of linux/cpuidle.h is 10.
        ("idle states", {"latency": "50"}, Verdict.GOOD, DEEPEST(50)),
        ("idle states", {"state0/latency": "2", "state9/latency": "51"}, Verdict.HINT, DEEPEST(51)),
        ("idle states", {"latency": "680", "disable": "1"}, Verdict.ABSENT, STATES),
        ("idle states", {}, Verdict.ABSENT, STATES),
        ("clock source", {"current_clocksource": "tsc"}, Verdict.GOOD, "tsc"),
        ("clock source", {"current_clocksource": "hpet"}, Verdict.HINT, "hpet"),
        ("clock source", {}, Verdict.HINT, "unknown"),
    ],
)
def test_a_file_of_the_kernel_is_judged_and_named(name, files, verdict, value):
    found = finding(name, reader(**files))
    assert (found.verdict, found.value) == (verdict, value)
    assert bool(found.advice) == (verdict is Verdict.HINT)


@pytest.mark.parametrize(
    ("count", "isolated", "tickless", "verdict", "advice"),
    [
        (4, "2-3", "2-3", Verdict.GOOD, ""),
        (4, "2-3", "(null)", Verdict.HINT, "'nohz_full=2-3' too, and give --realtime-cpu 2"),
        (4, "", "", Verdict.HINT, "'isolcpus=3 nohz_full=3', and give --realtime-cpu 3"),
        (1, "", "", Verdict.ABSENT, ""),
    ],
)
def test_an_isolated_processor_is_there_or_told_of(
    monkeypatch, count, isolated, tickless, verdict, advice
):
    monkeypatch.setattr("hil_bench.abilities.doctor.machine.os.cpu_count", lambda: count)
    item = finding("isolated processors", reader(isolated=isolated, nohz_full=tickless))
    assert item.verdict is verdict
    assert item.advice.endswith(advice)


@pytest.mark.parametrize(
    ("count", "load", "words", "verdict"),
    [
        (None, 0.4, "0.4 on 1 processor", Verdict.GOOD),  # a system that does not count them
        (1, 0.5, "0.5 on 1 processor", Verdict.HINT),
        (2, 0.9, "0.9 on 2 processors", Verdict.GOOD),
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
