"""Real-time scheduling of a thread by Linux, and the permissions that it takes."""

import gc
import logging
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path

from hil_bench.outside.realtime import linux
from hil_bench.outside.realtime.clock import RealtimeConfig, RealtimePolicy

# The real-time permissions of this process, and the remedies for missing ones.

IS_LINUX = sys.platform.startswith("linux")

NOT_LINUX = "this is there on Linux only"

GRANT_PRIORITY = (
    "grant CAP_SYS_NICE, or 'rtprio 95' in /etc/security/limits.conf; in a container "
    "'--cap-add SYS_NICE'"
)
GRANT_DEADLINE = (
    "grant CAP_SYS_NICE and all processors (no taskset, no cpuset), or take fifo; in a container "
    "'--cap-add SYS_NICE'"
)
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


# Requests to the operating system that keep the loop from being held up.
#
# Some of it needs no permission: the garbage collector is set aside, and the timer slack is 1 ns
# in place of 50 us. The rest is what `RealtimeConfig` wants: a real-time policy, locked memory,
# processors that stay awake, a processor of its own. What the system refuses is left out, with
# one warning that says what to grant.
#
# A loop with a real-time policy that never waits would take its processor from everybody else.
# After `SPIN` without a wait it loses the policy, with a warning; where Python does not come to
# see to that, the kernel ends the process after `LONGEST_SPIN`.

logger = logging.getLogger(__name__)

TIMER_SLACK = 1
"""How late the kernel may wake the loop [ns]."""

DEADLINE_SHARE = 0.5
"""Share of each period that SCHED_DEADLINE reserves for the loop, which is also all it gives."""

SPIN = 1.0
"""Longest time that a loop keeps its real-time policy without waiting [s]."""

LONGEST_SPIN = 5.0
"""Longest time that a process with a real-time policy lives without waiting [s]."""


@contextmanager
def undisturbed_by_garbage_collection() -> Iterator[None]:
    """Keep the cyclic garbage collector out of a paced run.

    What exists at the start is collected once and then set aside; until the end nothing is
    searched. Reference counting still frees what the ticks use, as long as they build no cycles.
    The collector is left as it was found, after an exception too: what the caller has set aside
    stays so, and then nothing more is, since both would come back as one.
    """
    was_enabled, sets_aside = gc.isenabled(), gc.get_freeze_count() == 0
    gc.collect()
    if sets_aside:
        gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        if sets_aside:
            gc.unfreeze()
        if was_enabled:
            gc.enable()


@contextmanager
def undisturbed(realtime: RealtimeConfig, period: int) -> Iterator[Sequence[str]]:
    """Let nothing hold up the paced loop of this thread, as far as the system permits.

    All is as it was when the block ends.

    Args:
        realtime: what to ask for beyond what needs no permission.
        period: time between ticks [ns].

    Yields:
        The names of what needs permission and is held.
    """
    held = []
    with ExitStack() as stack:
        stack.enter_context(undisturbed_by_garbage_collection())
        _reduce_timer_slack(stack)
        for take, name, refused, grant in _wanted(realtime, period):
            try:
                take(stack)
            except (OSError, OverflowError):
                logger.warning("%s; %s", refused, grant if IS_LINUX else NOT_LINUX)
            else:
                held.append(name)
        if realtime.spin:
            held.append(f"busy for {realtime.spin / 1e3:g} of each {period / 1e3:g} us")
        yield held


_Take = Callable[[ExitStack], None]


def _wanted(realtime: RealtimeConfig, period: int) -> Iterator[tuple[_Take, str, str, str]]:
    """Yield what to take, its name, what to say where it is refused, and what to grant.

    Yields:
        The four.
    """
    if realtime.cpu is not None:
        permitted = f"this process may use {format_cpus(linux.processors())}" if IS_LINUX else ""
        name = f"processor {realtime.cpu}"
        take = partial(_take_processor, cpu=realtime.cpu)
        yield take, name, f"loop not tied to {name}", permitted
    if realtime.policy is RealtimePolicy.OFF:
        return
    yield _lock_memory, "memory", "memory not locked", GRANT_MEMORY
    yield _hold_latency, "wake-up latency 0 us", "processors not kept awake", GRANT_LATENCY
    if realtime.policy is RealtimePolicy.FIFO:
        take = partial(_take_fifo, priority=realtime.priority)
        refused = f"no SCHED_FIFO with priority {realtime.priority}"
        yield take, f"SCHED_FIFO {realtime.priority}", refused, GRANT_PRIORITY
    else:
        take = partial(_take_deadline, period=period)
        yield take, "SCHED_DEADLINE", "no SCHED_DEADLINE", GRANT_DEADLINE


def _reduce_timer_slack(stack: ExitStack) -> None:
    with suppress(OSError):  # other systems have none
        stack.callback(linux.set_timer_slack, linux.timer_slack())
        linux.set_timer_slack(TIMER_SLACK)


def _take_processor(stack: ExitStack, *, cpu: int) -> None:
    before = linux.processors()
    linux.set_processors({cpu})
    stack.callback(linux.set_processors, before)


def _lock_memory(stack: ExitStack) -> None:
    if not may_lock_memory():
        raise PermissionError
    linux.lock_memory()
    stack.callback(linux.unlock_memory)


def _hold_latency(stack: ExitStack) -> None:
    stack.callback(linux.hold_wake_latency())


def _take_fifo(stack: ExitStack, *, priority: int) -> None:
    _limit_spinning(stack)
    restore = linux.policy_restorer()
    linux.set_fifo_policy(priority)
    stack.callback(restore)


def _take_deadline(stack: ExitStack, *, period: int) -> None:
    _limit_spinning(stack)
    restore = linux.policy_restorer()
    linux.set_deadline_policy(round(DEADLINE_SHARE * period), period)
    stack.callback(restore)


def _limit_spinning(stack: ExitStack) -> None:
    """Have the kernel watch that the loop waits; only the main thread can hear of it."""
    if threading.current_thread() is not threading.main_thread():
        return
    stack.callback(linux.limit_spinning(SPIN, LONGEST_SPIN))
    before = signal.signal(signal.SIGXCPU, _give_up_policy)
    stack.callback(signal.signal, signal.SIGXCPU, before)


def _give_up_policy(_signal: int, _frame: object) -> None:
    """Answer SIGXCPU, which comes each second while the loop spins."""
    linux.set_normal_policy()
    logger.warning(
        "the loop ran for %g s without waiting: it goes on at normal priority, so that this "
        "machine can be used; give it less to do or a longer tick_us",
        SPIN,
    )
