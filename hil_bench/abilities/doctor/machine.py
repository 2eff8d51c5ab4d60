"""Kernel, processors and clock."""

import gzip
import os
import platform
import re
from pathlib import Path

from hil_bench.abilities.doctor.finding import (
    IS_LINUX,
    Finding,
    Read,
    Topic,
    absent,
    first_match,
    good,
    judged,
)

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
    except (OSError, ValueError):
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
