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


class Instructions(Protocol):
    """The instructions of a core, which the caller keeps as long as its engine."""

    count: int
    """Since the last start, also in the middle of them."""
    traps_all: bool
    """True if words and halfwords are to be aligned, too, beside those that always are."""

    def start(self, address: int, count: int) -> int:
        """Do up to a number of them; an exception of a function that is called ends it."""

    def add_code(self, address: int, size: int, place: int) -> None:
        """Look at the accesses of those in a range, whose bytes are at a place of this process."""


class Calls(Protocol):
    """The functions of ``_calls.c``; an int that one returns is unicorn's number of an error."""

    def use(self, *addresses: int) -> None:
        """Take unicorn's functions by their addresses."""

    def stop(self, handle: int) -> None:
        """Have a start return."""

    def read(self, handle: int, address: int, size: int) -> bytes | int:
        """Return bytes of memory, 256 at most."""

    def write(self, handle: int, address: int, data: bytes) -> int:
        """Write bytes to memory."""

    def map_functions(
        self,
        handle: int,
        address: int,
        size: int,
        functions: tuple[Callable[[int, int], int], Callable[[int, int, int], None]],
    ) -> int:
        """Have functions read and write a range; the caller keeps their tuple."""

    def hook_traps(self, handle: int, take: Callable[[int], None]) -> int:
        """Have a function, which the caller keeps, take the number of each trap."""

    def Registers(self, handle: int, numbers: tuple[int, ...]) -> Registers:  # noqa: N802 - a class
        """Return some registers by unicorn's numbers."""

    def Instructions(  # noqa: N802 - likewise
        self, handle: int, take: Callable[[int], None], registers: tuple[int, ...]
    ) -> Instructions:
        """Have a function take the address of an access that is not aligned, in front of it."""


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
