"""A core and its calls of unicorn in C (``core``): of the wheel, or compiled at their first use.

Unicorn's Python wrapper, and ctypes, take longer than the work for what is short.
"""

import ctypes
import hashlib
import importlib.util
import sysconfig
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Final, Protocol, cast

from unicorn.unicorn_py3.unicorn import uclib

from hil_bench.abilities.controllers.program.compile import FLAGS, compile_files
from hil_bench.abilities.controllers.program.preload import compiled_once

LIBRARY: Final = ctypes.CDLL(uclib._name)  # noqa: SLF001 - a handle of our own, with types of our own
"""Unicorn."""

DIVIDES: Final = -3
"""A core is in front of a division by zero."""
UNALIGNED: Final = -4
"""A core is in front of an access that is not aligned."""
PAUSES: Final = -5
"""Somebody wants to do something before it goes on."""
NO_ROOM: Final = -6
"""An exception has no room on the stack."""
NO_EXCEPTION: Final = -7
"""A return from an exception where there is none."""
NO_FRAME: Final = -8
"""Nothing is on the stack to return to."""
ERRORS: Final = 1000
"""Unicorn's numbers of errors begin behind it."""

_NAME = "_calls"
_FOLDER = Path(__file__).with_name("core")
_INCLUDE = sysconfig.get_path("include")
_USED = (
    *("uc_emu_start", "uc_emu_stop", "uc_mem_read", "uc_mem_write"),
    *("uc_reg_read_batch", "uc_reg_write_batch", "uc_mmio_map", "uc_hook_add"),
)


class Registers(Protocol):
    """Some registers, read and written together."""

    def read(self) -> list[int]:
        """Return their values."""

    def write(self, values: Sequence[int]) -> None:
        """Set them, in their order."""


class Alarm(Protocol):
    """Something that is due at a time, unless it is cancelled."""

    @property
    def time(self) -> int:
        """The time at which it is due [ns]."""

    @property
    def is_on(self) -> bool:
        """False once it was cancelled or is over."""

    def cancel(self) -> None:
        """Have nothing happen then."""


class Timeline(Protocol):
    """All that is due, in order of time."""

    def add(self, time: int, action: Callable[[], None]) -> Alarm:
        """Have something happen at a time [ns]."""

    def next_time(self, end: int) -> int:
        """Return the time of what is due next [ns], at most `end`."""

    def fire(self, now: int) -> None:
        """Do what is due by now [ns]."""


class Exceptions(Protocol):
    """The state of all exceptions (Armv7-M ARM, B1.5)."""

    pending: int
    """A bit for each number of an exception."""
    enabled: int
    """Likewise."""
    group_bits: int
    """Bits of a priority below its point, which do not preempt."""

    @property
    def count(self) -> int:
        """One more than the highest number."""

    @property
    def lines(self) -> int:
        """A bit for each interrupt whose peripheral asks for it."""

    @property
    def active(self) -> list[int]:
        """The numbers of those that have begun, the last one last."""

    @property
    def priorities(self) -> list[int]:
        """Of each, by number; lower is more urgent."""

    @property
    def priority(self) -> int:
        """The priority at which code runs now, masks left aside."""

    def reset(self) -> None:
        """Begin anew, with nothing pending and no interrupt enabled."""

    def set_priority(self, number: int, value: int) -> None:
        """Set the priority of an exception, as far as the chip has bits for it."""

    def find_due(self, ceiling: int) -> int:
        """Return the exception that preempts what runs at a priority, 0 for none."""

    def begin(self, number: int) -> None:
        """Take note that an exception is entered."""

    def end(self) -> None:
        """Take note that the last one is over; one whose line is still active comes again."""

    def hold_line(self, number: int, *, is_active: bool) -> None:
        """Set the level of the line of an exception."""


class Core(Protocol):
    """A core, which the caller keeps as long as its engine: its life from event to event."""

    vectors: int
    """The address of its table of exceptions."""
    sleeps_on_exit: bool
    """True if it sleeps when the last exception is over."""
    traps_all: bool
    """True if words and halfwords are to be aligned, too, beside those that always are."""

    @property
    def at(self) -> int:
        """The address where it goes on."""

    @property
    def reached(self) -> int:
        """The address that was not aligned, or of the stack."""

    @property
    def number(self) -> int:
        """The number of the exception that found no room."""

    def live(self, until: int) -> int:
        """Live until a moment [ns]; return 0, or why it cannot.

        A number above 0 is unicorn's of a trap, or behind `ERRORS` of an error; others are those
        above and what `trap` was given. An exception of a function that is called ends it, too.
        """

    def pause(self) -> None:
        """End `live` with `PAUSES` behind the write that the program is doing."""

    def look(self) -> None:
        """Look for exceptions behind the write that the program is doing."""

    def pend(self, exception: int) -> None:
        """Make an exception pending."""

    def hold_line(self, interrupt: int, *, is_active: bool) -> None:
        """Set the level of an interrupt's line: pending again for as long as it is active."""

    def alarm(self, time: int, action: Callable[[], None]) -> Alarm:
        """Have something happen at a time [ns], in the middle of what runs if need be."""

    def trap(self, number: int) -> None:
        """End `live` with a number, in front of the instruction."""

    def now(self) -> int:
        """Return the time, to the instruction [ns]."""

    def wake(self) -> int | None:
        """Return when it wakes unless something comes from outside [ns]; None awake."""

    def set_time(self, time: int) -> None:
        """Go on from a time [ns]."""

    def begin(self, at: int) -> None:
        """Begin at an address, awake and with nothing due; the time goes on."""

    def map(
        self,
        address: int,
        size: int,
        read: Callable[[int, int], int],
        write: Callable[[int, int, int], None],
        cells: tuple[object, ...] | None,
    ) -> int:
        """Have functions answer for a range, but for registers of `Cells`."""

    def add_memory(self, address: int, size: int, place: int, is_fixed: bool) -> None:
        """Know the bytes of memory at a place of this process; fixed ones never change."""


class Calls(Protocol):
    """The functions of ``core``; an int that one returns is unicorn's number of an error."""

    def use(self, *addresses: int) -> None:
        """Take unicorn's functions by their addresses."""

    def read(self, handle: int, address: int, size: int) -> bytes | int:
        """Return bytes of memory, 256 at most."""

    def write(self, handle: int, address: int, data: bytes) -> int:
        """Write bytes to memory."""

    def Registers(self, handle: int, numbers: tuple[int, ...]) -> Registers:  # noqa: N802 - a class
        """Return some registers by unicorn's numbers."""

    def Core(  # noqa: N802 - likewise
        self,
        handle: int,
        per_ms: int,
        has_masks: bool,
        has_floats: bool,
        exceptions: Exceptions,
    ) -> Core:
        """Return a core that does so many instructions in a millisecond."""

    def Exceptions(self, priority_bits: int, interrupts: int) -> Exceptions:  # noqa: N802
        """Return the exceptions of a chip: bits of a priority, and how many interrupts."""

    def Timeline(self) -> Timeline:  # noqa: N802
        """Return a time without anything due."""


@cache
def find_calls() -> Calls:
    """Return the calls, compiled now where no wheel or earlier run has brought them."""
    try:
        from hil_bench.abilities.controllers.elf import (  # type: ignore[attr-defined]  # noqa: PLC0415
            _calls,
        )
    except ImportError:
        calls = _load(compiled_calls())
    else:
        calls = cast("Calls", _calls)
    calls.use(*(ctypes.cast(LIBRARY[name], ctypes.c_void_p).value or 0 for name in _USED))
    return calls


def compiled_calls() -> Path:
    """Return the file of this user's own, compiled unless it is there; see `compiled_once`."""
    sources = (path.read_text(encoding="utf-8") for path in sorted(_FOLDER.glob("*.[ch]")))
    made_of = (*FLAGS, sysconfig.get_config_var("EXT_SUFFIX"), *sources)
    digest = hashlib.sha256("\0".join(made_of).encode()).hexdigest()[:16]
    return compiled_once(f"elf-{digest}", "elf", _compile, "gcc and the headers of Python")


def _compile(target: Path) -> None:
    compile_files(target, sorted(_FOLDER.glob("*.c")), "-isystem", _INCLUDE)


def _load(path: Path) -> Calls:
    spec = importlib.util.spec_from_file_location(_NAME, path)
    if spec is None or spec.loader is None:
        raise ImportError(path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return cast("Calls", module)
