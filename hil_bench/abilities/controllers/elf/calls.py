"""Calls of unicorn in machine code (``_calls.c``): of the wheel, or compiled at their first use.

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

SLEEPS: Final = -1
"""A start has ended behind WFI."""
WAITS: Final = -2
"""A start has ended behind WFE."""
DIVIDES: Final = -3
"""A start has ended in front of a division by zero."""
UNALIGNED: Final = -4
"""A start has ended in front of an access that is not aligned."""
ERRORS: Final = 1000
"""Unicorn's numbers of errors begin behind it."""

_NAME = "_calls"
_SOURCE = Path(__file__).with_name(f"{_NAME}.c")
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


class Core(Protocol):
    """A core, which the caller keeps as long as its engine: its time, its exceptions' frames."""

    at: int
    """The address where it goes on."""
    reached: int
    """The address of the access that was not aligned."""
    traps_all: bool
    """True if words and halfwords are to be aligned, too, beside those that always are."""

    def start(self, count: int) -> int:
        """Do up to a number of instructions; return why it ended, 0 for nothing to do.

        A number above 0 is unicorn's of a trap, or behind `ERRORS` of an error; others are
        `SLEEPS`, `WAITS`, `UNALIGNED` and what `trap` was given. An exception of a function that
        is called ends it, too.
        """

    def interrupt(self) -> None:
        """Have a start return behind the write that the program is doing, with its effect."""

    def trap(self, number: int) -> None:
        """Have a start return a number."""

    def now(self) -> int:
        """Return the time, to the instruction [ns]."""

    def set_time(self, time: int) -> None:
        """Go on from a time [ns]."""

    def enter(self, number: int, vectors: int) -> int | None:
        """Enter an exception by the table of vectors; return where the stack has no room."""

    def chain(self, number: int, vectors: int) -> None:
        """Enter an exception behind the end of another."""

    def end_exception(self) -> None:
        """Clear FAULTMASK."""

    def leave(self) -> int | None:
        """Return to what the stack has kept; return the stack's address where nothing is."""

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
    """The functions of ``_calls.c``; an int that one returns is unicorn's number of an error."""

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
    ) -> Core:
        """Return a core that does so many instructions in a millisecond."""


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
    made_of = (*FLAGS, sysconfig.get_config_var("EXT_SUFFIX"), _SOURCE.read_text(encoding="utf-8"))
    digest = hashlib.sha256("\0".join(made_of).encode()).hexdigest()[:16]
    return compiled_once(f"elf-{digest}", "elf", _compile, "gcc and the headers of Python")


def _compile(target: Path) -> None:
    compile_files(target, (_SOURCE,), "-isystem", _INCLUDE)


def _load(path: Path) -> Calls:
    spec = importlib.util.spec_from_file_location(_NAME, path)
    if spec is None or spec.loader is None:
        raise ImportError(path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return cast("Calls", module)
