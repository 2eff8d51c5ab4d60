"""The machine: its clock, its processors, its permissions, and findings about them."""

import gzip
import os
import platform
import re
import sys
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple

from hil_bench.bench.assembly import build_bench
from hil_bench.bench.bench import Bench
from hil_bench.bench.configuration import BenchConfig, RealtimeConfig, RealtimePolicy
from hil_bench.bench.paced import run_paced
from hil_bench.bench.session import Session
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.realtime import linux, scheduling
from hil_bench.outside.realtime.clock import Clock
from hil_bench.outside.realtime.pacer import Pacer
from hil_bench.outside.realtime.statistics import TickSummary
from hil_bench.outside.transports.transport import TransportCounters

# The findings of an examination, and the reading of the kernel's files.

IS_LINUX = sys.platform.startswith("linux")


class Verdict(StrEnum):
    """The meaning of a finding for a bench in real time."""

    GOOD = "good"
    """Nothing is to be changed."""
    HINT = "hint"
    """It works; a change would make it better."""
    MISSING = "missing"
    """Something does not work without a change."""
    ABSENT = "absent"
    """This system has no such thing."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One fact.

    Attributes:
        name: what was looked at.
        verdict: what it means.
        value: what is there, in words.
        advice: what to change, in one line; empty where nothing is.
    """

    name: str
    verdict: Verdict
    value: str
    advice: str = ""


@dataclass(frozen=True, slots=True)
class Topic:
    """The findings on one subject.

    Attributes:
        name: the subject.
        findings: the facts.
    """

    name: str
    findings: tuple[Finding, ...]


Read = Callable[[str], str]
"""Returns the text of a file of the kernel, empty where there is none."""


def read_file(path: str) -> str:
    """Return the text of a file without white space at its ends, empty where it cannot be read."""
    try:
        return Path(path).read_text("utf-8", "replace").strip()
    except OSError:
        return ""


def good(name: str, value: str) -> Finding:
    """Return a finding about which nothing is to be done."""
    return Finding(name, Verdict.GOOD, value)


def absent(name: str, value: str = "not on this system") -> Finding:
    """Return a finding about what this system does not have."""
    return Finding(name, Verdict.ABSENT, value)


def judged(name: str, value: str, advice: str, *, is_good: bool) -> Finding:
    """Return a finding that is good, or a hint with advice."""
    return good(name, value) if is_good else Finding(name, Verdict.HINT, value, advice)


def first_match(text: str, beginnings: Iterable[str]) -> str:
    """Return the rest of the first word of a text with one of these beginnings, or nothing."""
    for word in text.split():
        for beginning in beginnings:
            if word.startswith(beginning):
                return word.removeprefix(beginning)
    return ""


# Kernel, processors and clock.

_PROCESSORS = "/sys/devices/system/cpu"
_GOOD_CLOCKS = frozenset({"tsc", "arch_sys_counter", "kvm-clock", "hyperv_clocksource_tsc_page"})
_LONGEST_EXIT = 50  # from an idle state, that a loop at 1 kHz does not mind [us]


def examine_machine(read: Read) -> Topic:
    """Return the findings on kernel and processors.

    Args:
        read: reads files of the kernel.
    """
    if not IS_LINUX:
        return Topic("Machine", (good("system", platform.platform()),))
    return Topic(
        "Machine",
        (
            good("kernel", f"{platform.release()}{_virtual(read('/proc/cpuinfo'))}"),
            _preemption(read, platform.version()),
            _load(),
            _isolation(read),
            _governor(read),
            _idle_states(read),
            _clock(read("/sys/devices/system/clocksource/clocksource0/current_clocksource")),
        ),
    )


def _virtual(cpuinfo: str) -> str:
    return ", virtual machine: the host may hold up ticks" if " hypervisor" in cpuinfo else ""


def _preemption(read: Read, version: str) -> Finding:
    name = "preemption"
    if read("/sys/kernel/realtime") == "1" or "PREEMPT_RT" in version:
        return good(name, "PREEMPT_RT")
    model = preemption_model(read)
    return judged(
        name,
        model or "unknown",
        "boot with 'preempt=full', or with a PREEMPT_RT kernel (Debian: linux-image-rt-amd64)",
        is_good=model == "full",
    )


def preemption_model(read: Read) -> str:
    """Return the kernel's preemption model: none, voluntary, lazy or full."""
    mode = re.search(r"\((\w+)\)", read("/sys/kernel/debug/sched/preempt"))
    if mode:
        return mode.group(1)
    chosen = first_match(read("/proc/cmdline"), ("preempt=",))
    if chosen:
        return chosen
    built = re.search(
        r"^CONFIG_PREEMPT(?:_(NONE|VOLUNTARY|LAZY))?=y$", _kernel_config(read), re.MULTILINE
    )
    return (built.group(1) or "full").lower() if built else ""


def _kernel_config(read: Read) -> str:
    try:
        return gzip.decompress(Path("/proc/config.gz").read_bytes()).decode()
    except OSError:
        return read(f"/boot/config-{platform.release()}")


def _load() -> Finding:
    count, load = os.cpu_count() or 1, os.getloadavg()[0]
    return judged(
        "load",
        f"{load:.1f} on {count} processor{'s' * (count > 1)}",
        "what else runs here competes with the loop and its controller; end it or move it",
        is_good=load < max(count - 1, 0.5),
    )


def _isolation(read: Read) -> Finding:
    isolated = read(f"{_PROCESSORS}/isolated")
    tickless = read(f"{_PROCESSORS}/nohz_full").replace("(null)", "")
    last = (os.cpu_count() or 1) - 1
    if not isolated and not last:
        return absent("isolated processors", "none: there is one processor only")
    first = isolated.split(",")[0].split("-")[0]
    advice = (
        f"boot with 'nohz_full={isolated}' too, and give --realtime-cpu {first}"
        if isolated
        else f"boot with 'isolcpus={last} nohz_full={last}', and give --realtime-cpu {last}"
    )
    return judged(
        "isolated processors",
        f"{isolated or 'none'}; nohz_full {tickless or 'none'}",
        advice,
        is_good=bool(isolated and tickless),
    )


def _governor(read: Read) -> Finding:
    name = "frequency governor"
    governors = {
        governor
        for cpu in range(os.cpu_count() or 1)
        if (governor := read(f"{_PROCESSORS}/cpu{cpu}/cpufreq/scaling_governor"))
    }
    if not governors:
        return absent(name, "none: the frequency is not the kernel's to choose")
    return judged(
        name,
        ", ".join(sorted(governors)),
        "'cpupower frequency-set -g performance'",
        is_good=governors == {"performance"},
    )


def _idle_states(read: Read) -> Finding:
    latencies = [
        int(latency)
        for state in range(10)
        if (latency := read(f"{_PROCESSORS}/cpu0/cpuidle/state{state}/latency")).isdigit()
        and read(f"{_PROCESSORS}/cpu0/cpuidle/state{state}/disable") != "1"
    ]
    if not latencies:
        return absent("idle states", "none that the kernel chooses")
    return judged(
        "idle states",
        f"the deepest takes {max(latencies)} us to wake from",
        "'tuned-adm profile latency-performance', or boot with 'intel_idle.max_cstate=1'",
        is_good=max(latencies) <= _LONGEST_EXIT,
    )


def _clock(source: str) -> Finding:
    return judged(
        "clock source",
        source or "unknown",
        "a slow clock costs each tick some us; 'clocksource=tsc' where the processor has it",
        is_good=source in _GOOD_CLOCKS,
    )


# Measurement of this machine's lateness in waking the bench's loop.


class LatenessTest(NamedTuple):
    """One measurement.

    Attributes:
        name: how `hil-bench run` is called to run like this.
        summary: what the loop did.
    """

    name: str
    summary: TickSummary


def measure_lateness(
    config: BenchConfig, seconds: float, policies: list[RealtimePolicy], clock: Clock
) -> list[LatenessTest]:
    """Measure the lateness of the whole bench on a silent bus, once with each policy.

    Args:
        config: the bench.
        seconds: length of all together [s].
        policies: those to try.
        clock: the clock to wait on.
    """
    ticks = max(round(seconds / len(policies) * 1e9 / config.tick_ns), 1)
    names = {RealtimePolicy.OFF: "run"}
    return [
        LatenessTest(
            names.get(policy, f"run --realtime {policy.value}"),
            _run(build_bench(config), Pacer(clock, config.tick_ns), policy, ticks),
        )
        for policy in policies
    ]


class SilentTransport:
    """A transport that brings nothing and drops what it is given.

    Attributes:
        description: the bus in words.
        has_exact_wait: never.
    """

    description = "silent"
    has_exact_wait = False

    def receive(self, limit: int) -> list[Frame]:  # noqa: ARG002 - the protocol's
        """Return nothing."""
        return []

    def wait(self, timeout: float) -> bool:  # noqa: ARG002 - the protocol's
        """Return False at once."""
        return False

    def send(self, frames: Sequence[Frame]) -> None:
        """Drop the frames."""

    def listen_to(self, can_ids: Iterable[int]) -> None:
        """Do nothing."""

    def counters(self) -> TransportCounters:
        """Return zeros."""
        return TransportCounters()

    def close(self) -> None:
        """Do nothing."""


def _run(bench: Bench, pacer: Pacer, policy: RealtimePolicy, ticks: int) -> TickSummary:
    return run_paced(
        Session(bench),
        SilentTransport(),
        pacer,
        stopped=lambda: pacer.statistics.ticks + pacer.statistics.skipped >= ticks,
        realtime=RealtimeConfig(policy=policy),
    ).ticks


# The permissions of this process in the kernel.

_PRIORITY = 80
_PERIOD = 1_000_000  # [ns]
_ALL_PROCESSORS = "it takes all processors: start without taskset or cpuset, or take fifo"


def examine_permissions(read: Read) -> Topic:
    """Return the findings on the permissions of this process.

    Args:
        read: reads files of the kernel.
    """
    if not IS_LINUX:
        names = ("SCHED_FIFO", "SCHED_DEADLINE", "memory lock", "wake-up latency")
        return Topic("Permissions", tuple(absent(name, "Linux only") for name in names))
    processors = good("processors", f"{scheduling.format_cpus(linux.processors())} permitted")
    throttling = _throttling(read("/proc/sys/kernel/sched_rt_runtime_us"))
    permitted = (_fifo(), _deadline(), _memory_lock(), _wake_latency())
    return Topic("Permissions", (*permitted, throttling, _timer_slack(), processors))


def _fifo() -> Finding:
    finding = _policy(
        "SCHED_FIFO", lambda: linux.set_fifo_policy(_PRIORITY), scheduling.GRANT_PRIORITY
    )
    return replace(finding, value=f"{finding.value}; RLIMIT_RTPRIO {linux.priority_limit()}")


def _deadline() -> Finding:
    return _policy(
        "SCHED_DEADLINE",
        lambda: linux.set_deadline_policy(round(scheduling.DEADLINE_SHARE * _PERIOD), _PERIOD),
        scheduling.GRANT_DEADLINE,
        is_tied=len(linux.processors()) < (os.cpu_count() or 1),
    )


def _policy(name: str, take: Callable[[], None], grant: str, *, is_tied: bool = False) -> Finding:
    """Find out by trying, in a thread that ends at once."""
    refusals: list[OSError] = []

    def try_it() -> None:
        try:
            take()
        except OSError as error:
            refusals.append(error)

    thread = threading.Thread(target=try_it)
    thread.start()
    thread.join()
    if not refusals:
        return good(name, "permitted")
    if scheduling.has_capability(scheduling.CAP_SYS_NICE):
        cgroup = "leave the cgroup, which gives no real-time time (cpu.rt_runtime_us), or give it"
        grant = _ALL_PROCESSORS if is_tied else cgroup
    return Finding(name, Verdict.HINT, f"refused: {refusals[0].strerror}", grant)


def _memory_lock() -> Finding:
    limit = linux.memory_limit()
    text = "unlimited" if limit is None else f"{limit / 2**20:g} MiB"
    if scheduling.may_lock_memory():
        return good("memory lock", f"permitted; RLIMIT_MEMLOCK {text}")
    return Finding("memory lock", Verdict.HINT, f"RLIMIT_MEMLOCK {text}", scheduling.GRANT_MEMORY)


def _wake_latency() -> Finding:
    name = "wake-up latency"
    if linux.may_hold_wake_latency():
        return good(name, "may be held at 0 us, as a run with --realtime does")
    return Finding(name, Verdict.HINT, "left to the idle states", scheduling.GRANT_LATENCY)


def _throttling(runtime: str) -> Finding:
    name = "real-time throttling"
    if not runtime.lstrip("-").isdigit():
        return absent(name, "unknown")
    advice = "'sysctl -w kernel.sched_rt_runtime_us=950000' leaves the rest a twentieth"
    if int(runtime) < 0:
        return Finding(name, Verdict.HINT, "off: a spinning thread takes a processor", advice)
    if int(runtime) == 0:
        return Finding(name, Verdict.HINT, "no time at all for real-time threads", advice)
    return good(name, f"{int(runtime) / 1e4:g} % for real-time threads")


def _timer_slack() -> Finding:
    return good("timer slack", f"{linux.timer_slack() / 1000:g} us; a paced run sets 1 ns")
