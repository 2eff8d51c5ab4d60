"""The real-time permissions of this process, and the remedies for missing ones."""

import sys
from collections.abc import Iterable
from pathlib import Path

from hil_bench.outside.realtime import linux

IS_LINUX = sys.platform.startswith("linux")

NOT_LINUX = "this is there on Linux only"

GRANT_PRIORITY = (
    "grant CAP_SYS_NICE, or 'rtprio 95' in /etc/security/limits.conf; in a container "
    "'--cap-add SYS_NICE'"
)
GRANT_DEADLINE = "grant CAP_SYS_NICE, or take fifo; in a container '--cap-add SYS_NICE'"
GRANT_MEMORY = (
    "grant CAP_IPC_LOCK, or 'memlock unlimited' in /etc/security/limits.conf; in a container "
    "'--ulimit memlock=-1'"
)
GRANT_LATENCY = (
    "make /dev/cpu_dma_latency writable for this user by a udev rule; in a container "
    "'--device /dev/cpu_dma_latency'"
)

# linux/capability.h
CAP_IPC_LOCK = 14
CAP_SYS_NICE = 23

_EVERYBODY = ["0", "0", "4294967295"]  # the uid_map outside of user namespaces


def may_lock_memory() -> bool:
    """Return True if this process may lock all memory that it has and will have.

    With a finite limit a lock would be worse than none: what comes later would be refused.
    """
    return IS_LINUX and (linux.memory_limit() is None or has_capability(CAP_IPC_LOCK))


def has_capability(number: int, process: Path = Path("/proc/self")) -> bool:
    """Return True if a process has a capability of linux/capability.h over the whole machine.

    In a user namespace, such as a container without root has, capabilities go no further than that.

    Args:
        number: the capability.
        process: where the kernel tells of the process.
    """
    try:
        lines = (process / "status").read_text("utf-8").splitlines()
        is_everywhere = (process / "uid_map").read_text("utf-8").split() == _EVERYBODY
    except OSError:
        return False
    masks = [int(line.split()[1], 16) for line in lines if line.startswith("CapEff:")]
    return is_everywhere and bool(masks and masks[0] >> number & 1)


def format_cpus(cpus: Iterable[int]) -> str:
    """Return a set of processors as the kernel writes it: ``0-3,6``."""
    runs: list[list[int]] = []
    for cpu in sorted(cpus):
        if runs and cpu == runs[-1][1] + 1:
            runs[-1][1] = cpu
        else:
            runs.append([cpu, cpu])
    return ",".join(f"{first}-{last}" if last > first else f"{first}" for first, last in runs)
