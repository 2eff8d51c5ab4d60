"""The permissions of this process in the kernel."""

import threading
from collections.abc import Callable
from dataclasses import replace

from hil_bench.abilities.doctor.finding import (
    IS_LINUX,
    Finding,
    Read,
    Topic,
    Verdict,
    absent,
    good,
)
from hil_bench.outside.realtime import linux
from hil_bench.outside.realtime.permissions import (
    CAP_SYS_NICE,
    GRANT_DEADLINE,
    GRANT_LATENCY,
    GRANT_MEMORY,
    GRANT_PRIORITY,
    format_cpus,
    has_capability,
    may_lock_memory,
)

_PRIORITY = 80
_PERIOD = 1_000_000  # [ns]


def examine_permissions(read: Read) -> Topic:
    """Return the findings on the permissions of this process.

    Args:
        read: reads files of the kernel.
    """
    if not IS_LINUX:
        names = ("SCHED_FIFO", "SCHED_DEADLINE", "memory lock", "wake-up latency")
        return Topic("Permissions", tuple(absent(name, "Linux only") for name in names))
    processors = good("processors", f"{format_cpus(linux.processors())} permitted")
    throttling = _throttling(read("/proc/sys/kernel/sched_rt_runtime_us"))
    permitted = (_fifo(), _deadline(), _memory_lock(), _wake_latency())
    return Topic("Permissions", (*permitted, throttling, _timer_slack(), processors))


def _fifo() -> Finding:
    finding = _policy("SCHED_FIFO", lambda: linux.set_fifo_policy(_PRIORITY), GRANT_PRIORITY)
    return replace(finding, value=f"{finding.value}; RLIMIT_RTPRIO {linux.priority_limit()}")


def _deadline() -> Finding:
    return _policy(
        "SCHED_DEADLINE",
        lambda: linux.set_deadline_policy(_PERIOD // 10, _PERIOD),
        GRANT_DEADLINE,
    )


def _policy(name: str, take: Callable[[], None], grant: str) -> Finding:
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
    if has_capability(CAP_SYS_NICE):
        grant = "leave the cgroup, which gives no real-time time (cpu.rt_runtime_us), or give it"
    return Finding(name, Verdict.HINT, f"refused: {refusals[0].strerror}", grant)


def _memory_lock() -> Finding:
    limit = linux.memory_limit()
    text = "unlimited" if limit is None else f"{limit / 2**20:g} MiB"
    if may_lock_memory():
        return good("memory lock", f"permitted; RLIMIT_MEMLOCK {text}")
    return Finding("memory lock", Verdict.HINT, f"RLIMIT_MEMLOCK {text}", GRANT_MEMORY)


def _wake_latency() -> Finding:
    name = "wake-up latency"
    if linux.may_hold_wake_latency():
        return good(name, "may be held at 0 us, as a run with --realtime does")
    return Finding(name, Verdict.HINT, "left to the idle states", GRANT_LATENCY)


def _throttling(runtime: str) -> Finding:
    name = "real-time throttling"
    if not runtime.lstrip("-").isdigit():
        return absent(name, "unknown")
    if int(runtime) < 0:
        advice = "'sysctl -w kernel.sched_rt_runtime_us=950000' leaves the rest a twentieth"
        return Finding(name, Verdict.HINT, "off: a spinning thread takes a processor", advice)
    return good(name, f"{int(runtime) / 1e4:g} % for real-time threads")


def _timer_slack() -> Finding:
    return good("timer slack", f"{linux.timer_slack() / 1000:g} us; a paced run sets 1 ns")
