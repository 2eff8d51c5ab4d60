"""Linux calls for a real-time thread, each of which acts at once.

Where the kernel refuses, an `OSError` says why; on other systems it is always ENOSYS. Sources:
prctl(2), mlockall(2), sched(7), sched_setattr(2), getrlimit(2) of the Linux manual pages; numbers
from linux/prctl.h, asm-generic/mman-common.h, linux/sched.h and asm-generic/unistd.h.
"""

import contextlib
import ctypes
import errno
import os
import platform
import struct
import sys
from collections.abc import Callable
from pathlib import Path

WAKE_LATENCY = Path("/dev/cpu_dma_latency")

_PR_SET_TIMERSLACK = 29
_PR_GET_TIMERSLACK = 30

_MCL_CURRENT = 1
_MCL_FUTURE = 2
_MCL_ONFAULT = 4

_SCHED_DEADLINE = 6
_RESET_ON_FORK = 1
# struct sched_attr: size, policy, flags, nice, priority, runtime, deadline, period.
_SCHED_ATTR = struct.Struct("=IIQiIQQQ")
_SCHED_SETATTR = {"x86_64": 314, "aarch64": 274, "riscv64": 274, "loongarch64": 274}


def timer_slack() -> int:
    """Return the time by which the kernel may delay this thread's waking to save energy [ns]."""
    return _call("prctl", _PR_GET_TIMERSLACK, 0, 0, 0, 0)


def set_timer_slack(slack: int) -> None:
    """Set how late the kernel may wake this thread [ns]: 50,000 is usual, 1 is the least.

    A thread with a real-time policy is woken at once whatever this says.
    """
    _call("prctl", _PR_SET_TIMERSLACK, slack, 0, 0, 0)


def lock_memory() -> None:
    """Keep in memory what of this process is in memory now or comes there later.

    Pages that nobody touches stay out: of a Python with its libraries, that is more than half.
    """
    _call("mlockall", _MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT)


def unlock_memory() -> None:
    """Undo `lock_memory`."""
    _call("munlockall")


def hold_wake_latency() -> Callable[[], None]:
    """Keep all processors out of idle states that they take time to leave (C1 and deeper).

    Documentation/power/pm_qos_interface.rst: a latency of 0 us holds as long as the file is open.

    Returns:
        What lets them go again.

    Raises:
        OSError: the kernel refuses, or this is another system.
    """
    _require_linux()
    device = os.open(WAKE_LATENCY, os.O_WRONLY)  # no file is made where there is no such device
    try:
        os.write(device, struct.pack("=i", 0))
    except OSError:
        os.close(device)
        raise
    return lambda: os.close(device)


def may_hold_wake_latency() -> bool:
    """Return True if `hold_wake_latency` is permitted; nothing is held.

    Access alone does not say it: a container may refuse the device itself.
    """
    try:
        os.close(os.open(WAKE_LATENCY, os.O_WRONLY))
    except OSError:
        return False
    return True


def processor() -> int:
    """Return the processor on which this thread runs now."""
    return _call("sched_getcpu")


def processors() -> set[int]:
    """Return the processors on which this thread may run."""
    _require_linux()
    return os.sched_getaffinity(0)


def threads(thread: int) -> list[int]:
    """Return all threads of the process of one; nothing where it has ended, or elsewhere."""
    with contextlib.suppress(OSError):
        return [int(path.name) for path in Path(f"/proc/{thread}/task").iterdir()]
    return []


def set_processors(cpus: set[int]) -> None:
    """Let this thread run on these processors only."""
    _require_linux()
    os.sched_setaffinity(0, cpus)


def policy_restorer() -> Callable[[], None]:
    """Return a function that restores this thread's present scheduling policy."""
    _require_linux()
    # Without CAP_SYS_NICE nobody can take the flag back, and it does no harm.
    policy = os.sched_getscheduler(0) | os.SCHED_RESET_ON_FORK
    parameters = os.sched_getparam(0)
    return lambda: os.sched_setscheduler(0, policy, parameters)


def set_normal_policy() -> None:
    """Give this thread SCHED_OTHER, the policy of every thread that asks for none."""
    _require_linux()
    os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))


def set_fifo_policy(priority: int) -> None:
    """Give this thread SCHED_FIFO with a priority of 1 to 99; what it starts gets SCHED_OTHER."""
    _require_linux()
    os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))


def set_deadline_policy(runtime: int, period: int) -> None:
    """Give this thread SCHED_DEADLINE: `runtime` [ns] of a processor in each `period` [ns].

    What it starts gets SCHED_OTHER. It may not be tied to single processors.

    Raises:
        OSError: the kernel refuses, or this machine's number of the system call is not known.
    """
    number = _SCHED_SETATTR.get(platform.machine())
    if number is None or sys.maxsize < 2**32:
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS))
    attributes = _SCHED_ATTR.pack(
        _SCHED_ATTR.size, _SCHED_DEADLINE, _RESET_ON_FORK, 0, 0, runtime, period, period
    )
    _call("syscall", number, 0, attributes, 0)


def memory_limit() -> int | None:
    """Return the limit of memory that this process may lock [byte], None for no limit."""
    return _limit("RLIMIT_MEMLOCK")


def priority_limit() -> int:
    """Return the highest real-time priority that this process may take without CAP_SYS_NICE."""
    limit = _limit("RLIMIT_RTPRIO")
    return 99 if limit is None else limit


def limit_spinning(soft: float, hard: float) -> Callable[[], None]:
    """Bound how long a thread with a real-time policy may run without a blocking call.

    Args:
        soft: after this time, and each second from then on, the process gets SIGXCPU [s].
        hard: after this time it is killed [s].

    Returns:
        What lifts the soft limit again; the hard one stays where the process may not raise it.
    """
    _require_linux()
    import resource  # noqa: PLC0415 - Windows has none

    before = resource.getrlimit(resource.RLIMIT_RTTIME)
    most = before[1] if before[1] != resource.RLIM_INFINITY else round(hard * 1e6)
    limits = (min(round(soft * 1e6), most), most)
    resource.setrlimit(resource.RLIMIT_RTTIME, limits)

    def lift() -> None:
        try:
            resource.setrlimit(resource.RLIMIT_RTTIME, before)
        except ValueError:
            resource.setrlimit(resource.RLIMIT_RTTIME, (most, most))

    return lift


def _limit(name: str) -> int | None:
    """Return a soft limit of this process, None for no limit."""
    _require_linux()
    import resource  # noqa: PLC0415 - Windows has none

    soft, _ = resource.getrlimit(getattr(resource, name))
    return None if soft == resource.RLIM_INFINITY else soft


def _require_linux() -> None:
    """Refuse to go on elsewhere.

    Raises:
        OSError: this is another system.
    """
    if not sys.platform.startswith("linux"):
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS))


def _call(name: str, *arguments: int | bytes) -> int:
    """Call the C library and return what it returns.

    Raises:
        OSError: the call failed, or this is another system.
    """
    _require_linux()
    function = getattr(ctypes.CDLL(None, use_errno=True), name)
    # A variadic function takes what it is given, and an int would be given as 32 bits.
    wide = [ctypes.c_ulong(value) if isinstance(value, int) else value for value in arguments]
    result: int = function(*wide)
    if result < 0:
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code))
    return result
