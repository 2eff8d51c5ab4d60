"""The engine of a core: unicorn in Thumb, its memory and its hooks."""

import ctypes
from collections.abc import Callable
from ctypes import CFUNCTYPE, byref, c_int, c_size_t, c_uint32, c_uint64, c_void_p
from typing import Any, Final

import unicorn

from hil_bench.abilities.controllers.elf.calls import (
    LIBRARY,
    Exceptions,
    Registers,
    find_calls,
)
from hil_bench.abilities.controllers.elf.cells import Cells

_CODE = CFUNCTYPE(None, c_void_p, c_uint64, c_uint32, c_void_p)
_MISS = CFUNCTYPE(ctypes.c_bool, c_void_p, c_int, c_uint64, c_int, ctypes.c_int64, c_void_p)
_map, _map_pointer = LIBRARY.uc_mem_map, LIBRARY.uc_mem_map_ptr
_map.argtypes = c_void_p, c_uint64, c_size_t, c_uint32
_map_pointer.argtypes = c_void_p, c_uint64, c_size_t, c_uint32, c_void_p

_PERIPHERALS = 0x4000_0000  # from here on nothing can be executed (Armv7-M ARM, B3.1)

READ_EXECUTE: Final = unicorn.UC_PROT_READ | unicorn.UC_PROT_EXEC
ALL: Final = unicorn.UC_PROT_ALL
_TRANSLATED = 1 << 25  # bytes for code of the host, which unicorn makes anew where they are full


class EngineError(Exception):
    """Unicorn has refused; its number says why."""

    def __init__(self, number: int) -> None:
        super().__init__(str(unicorn.UcError(number)))
        self.number = number


class Engine:
    """A core of unicorn in Thumb.

    Args:
        model: unicorn's number of the core.
        per_ms: instructions that it does in a millisecond.
        exceptions: of the chip.
        has_masks: whether it has BASEPRI and FAULTMASK.
        has_floats: whether it has an FPU.

    Attributes:
        handle: of unicorn.
        core: what runs.
    """

    def __init__(
        self,
        model: int,
        per_ms: int,
        exceptions: Exceptions,
        *,
        has_masks: bool,
        has_floats: bool,
    ) -> None:
        # Opened by the wrapper, which knows how a model is chosen.
        self._wrapper = unicorn.Uc(
            unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS
        )
        self._wrapper.ctl_set_cpu_model(model)
        self._wrapper.ctl_set_tcg_buffer_size(_TRANSLATED)
        self.handle = _address(self._wrapper)
        self._kept: list[object] = []  # functions that unicorn calls
        self._calls = calls = find_calls()
        self.core = calls.Core(self.handle, per_ms, has_masks, has_floats, exceptions)

    def registers(self, numbers: tuple[int, ...]) -> Registers:
        """Return some registers by unicorn's numbers, to read and write them together."""
        return self._calls.Registers(self.handle, numbers)

    def map(self, address: int, size: int, protection: int = ALL) -> None:
        """Map memory of unicorn's own."""
        _check(_map(self.handle, address, size, protection))

    def map_memory(self, address: int, memory: Any, protection: int = ALL) -> None:  # noqa: ANN401 - an array of ctypes
        """Map memory that stays the caller's."""
        at = ctypes.addressof(memory)
        if address < _PERIPHERALS:
            is_fixed = not protection & unicorn.UC_PROT_WRITE
            self.core.add_memory(address, len(memory), at, is_fixed)
        _check(_map_pointer(self.handle, address, len(memory), protection, at))

    def map_functions(
        self,
        address: int,
        size: int,
        read: Callable[[int, int], int],
        write: Callable[[int, int, int], None],
        cells: Cells | None,
    ) -> None:
        """Have functions answer for a range of addresses; see `Cpu.map_peripheral`."""
        _check(self.core.map(address, size, read, write, cells))

    def hook_address(self, address: int, take: Callable[[], None]) -> None:
        """Have a function called in front of the instruction at an address."""
        function = _CODE(lambda _engine, _address, _size, _data: take())
        self._hook(unicorn.UC_HOOK_CODE, function, address, address)

    def forget_translations(self) -> None:
        """Have hooks act on what has run already."""
        self._wrapper.ctl_flush_tb()

    def hook_misses(self, take: Callable[[int, int], bool]) -> None:
        """Have a function take kind and address of each access to where nothing is.

        Args:
            take: returns True if something is there now.
        """
        kinds = (
            unicorn.UC_HOOK_MEM_READ_UNMAPPED
            | unicorn.UC_HOOK_MEM_WRITE_UNMAPPED
            | unicorn.UC_HOOK_MEM_FETCH_UNMAPPED
            | unicorn.UC_HOOK_MEM_WRITE_PROT
        )
        function = _MISS(lambda _engine, kind, address, _size, _value, _data: take(kind, address))
        self._hook(kinds, function)

    def read(self, address: int, size: int) -> bytes:
        """Return bytes of memory.

        Raises:
            EngineError: nothing is there.
        """
        found = self._calls.read(self.handle, address, size)
        if isinstance(found, int):
            raise EngineError(found)
        return found

    def write(self, address: int, data: bytes) -> None:
        """Write bytes to memory; an `EngineError` says that nothing is there."""
        _check(self._calls.write(self.handle, address, data))

    def _hook(self, kinds: int, function: object, first: int = 1, last: int = 0) -> None:
        """Have unicorn call a function for a range of addresses; for all, where it ends first."""
        self._kept.append(function)
        begin, end = c_uint64(first), c_uint64(last)
        made, handle = c_size_t(), c_void_p(self.handle)
        _check(LIBRARY.uc_hook_add(handle, byref(made), kinds, function, None, begin, end))


def _check(number: int) -> None:
    """Check what unicorn has returned.

    Raises:
        EngineError: it is not 0.
    """
    if number:
        raise EngineError(number)


def _address(uc: Any) -> int:  # noqa: ANN401 - unicorn has no name for it
    """Return the address of unicorn's own record of an engine."""
    handle = uc._uch  # noqa: SLF001
    return int(getattr(handle, "value", handle))
