"""The processes of this machine, where the system lists them in `/proc`."""

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple


class ProcessStatus(NamedTuple):
    """The status of a process.

    Attributes:
        pid: its number.
        state: as `/proc` has it, such as ``R`` for running.
        group: the process group that it is in.
        session: the session that it is in.
    """

    pid: int
    state: str
    group: int
    session: int


def read_status(pid: int) -> ProcessStatus:
    """Return the status of a process; OSError where it has gone, or nothing is listed."""
    text = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    state, _, group, session, *_ = text.rpartition(")")[2].split()
    return ProcessStatus(pid, state, int(group), int(session))


def is_traced() -> bool:
    """Return True if a debugger, as gdb, or strace has this process."""
    try:
        text = Path("/proc/self/status").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    return "\nTracerPid:\t" in text and "\nTracerPid:\t0\n" not in text


def living() -> Iterator[ProcessStatus]:
    """Yield the processes that are not dead; those that nobody has waited for are listed, too."""
    for directory in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # it has just gone
            status = read_status(int(directory.name))
            if status.state not in "ZX":
                yield status
