"""Unicorn by its C functions: its Python wrapper takes longer than the work for what is short."""

import ctypes
from collections.abc import Callable, Sequence
from ctypes import CFUNCTYPE, POINTER, byref, c_int, c_size_t, c_uint, c_uint32, c_uint64, c_void_p
from typing import Any, Final

import unicorn
from unicorn.unicorn_py3.unicorn import uclib

_C = ctypes.CDLL(uclib._name)  # noqa: SLF001 - a handle of our own, with types of our own
_READ = CFUNCTYPE(c_uint64, c_void_p, c_uint64, c_uint, c_void_p)
_WRITE = CFUNCTYPE(None, c_void_p, c_uint64, c_uint, c_uint64, c_void_p)
_TRAP = CFUNCTYPE(None, c_void_p, c_uint32, c_void_p)
_CODE = CFUNCTYPE(None, c_void_p, c_uint64, c_uint32, c_void_p)
_MISS = CFUNCTYPE(ctypes.c_bool, c_void_p, c_int, c_uint64, c_int, ctypes.c_int64, c_void_p)
_FUNCTIONS: dict[str, tuple[Any, ...]] = {
    "uc_open": (c_int, c_int, POINTER(c_void_p)),
    "uc_close": (c_void_p,),
    "uc_mem_map": (c_void_p, c_uint64, c_size_t, c_uint32),
    "uc_mem_map_ptr": (c_void_p, c_uint64, c_size_t, c_uint32, c_void_p),
    "uc_mmio_map": (c_void_p, c_uint64, c_size_t, _READ, c_void_p, _WRITE, c_void_p),
    "uc_mem_read": (c_void_p, c_uint64, c_void_p, c_size_t),
    "uc_mem_write": (c_void_p, c_uint64, ctypes.c_char_p, c_size_t),
    "uc_reg_read_batch": (c_void_p, POINTER(c_int), POINTER(c_void_p), c_int),
    "uc_reg_write_batch": (c_void_p, POINTER(c_int), POINTER(c_void_p), c_int),
    "uc_emu_start": (c_void_p, c_uint64, c_uint64, c_uint64, c_size_t),
    "uc_emu_stop": (c_void_p,),
}
for _name, _arguments in _FUNCTIONS.items():
    _function = getattr(_C, _name)
    _function.argtypes, _function.restype = _arguments, c_int
_open, _close, _map, _map_pointer, _map_functions = (
    _C.uc_open,
    _C.uc_close,
    _C.uc_mem_map,
    _C.uc_mem_map_ptr,
    _C.uc_mmio_map,
)
_read, _write, _start, _stop = _C.uc_mem_read, _C.uc_mem_write, _C.uc_emu_start, _C.uc_emu_stop
_read_batch, _write_batch = _C.uc_reg_read_batch, _C.uc_reg_write_batch
_add_hook = _C.uc_hook_add
_add_hook.restype = c_int

READ_EXECUTE: Final = unicorn.UC_PROT_READ | unicorn.UC_PROT_EXEC
ALL: Final = unicorn.UC_PROT_ALL
INVALID_INSTRUCTION: Final = unicorn.UC_ERR_INSN_INVALID


class EngineError(Exception):
    """Unicorn has refused; its number says why."""

    def __init__(self, number: int) -> None:
        super().__init__(str(unicorn.UcError(number)))
        self.number = number


class Registers:
    """Some registers, read and written together.

    Args:
        engine: whose.
        numbers: of unicorn.
    """

    def __init__(self, engine: "Engine", numbers: Sequence[int]) -> None:
        count = len(numbers)
        self._values = (c_uint32 * count)()
        first = ctypes.addressof(self._values)
        pointers = (c_void_p * count)(*(first + 4 * place for place in range(count)))
        self._arguments = (engine.handle, (c_int * count)(*numbers), pointers, count)

    def read(self) -> list[int]:
        """Return their values."""
        _read_batch(*self._arguments)
        return self._values[:]

    def write(self, values: Sequence[int]) -> None:
        """Set them, in their order."""
        self._values[:] = list(values)
        _write_batch(*self._arguments)


class Engine:
    """A core of unicorn in Thumb.

    Args:
        model: unicorn's number of the core.

    Attributes:
        handle: of unicorn.
        count: the instructions since the last start, also in the middle of them.
    """

    def __init__(self, model: int) -> None:
        # Opened by the wrapper, which knows how a model is chosen.
        self._wrapper = unicorn.Uc(
            unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS
        )
        self._wrapper.ctl_set_cpu_model(model)
        self.handle = _address(self._wrapper)
        self._kept: list[object] = []  # functions that unicorn calls
        self._error: BaseException | None = None
        self._word = ctypes.create_string_buffer(8)
        self.count = c_uint64.from_address(self.handle + _counter_offset())

    def map(self, address: int, size: int, protection: int = ALL) -> None:
        """Map memory of unicorn's own."""
        _check(_map(self.handle, address, size, protection))

    def map_memory(self, address: int, memory: Any, protection: int = ALL) -> None:  # noqa: ANN401 - an array of ctypes
        """Map memory that stays the caller's."""
        at = ctypes.addressof(memory)
        _check(_map_pointer(self.handle, address, len(memory), protection, at))

    def map_functions(
        self,
        address: int,
        size: int,
        read: Callable[[int, int], int],
        write: Callable[[int, int, int], None],
    ) -> None:
        """Have functions answer for a range of addresses; see `Cpu.map_peripheral`."""

        def on_read(_engine: int, offset: int, size: int, _data: int) -> int:
            try:
                return read(offset, size)
            except BaseException as error:  # C is between us and the caller
                self._keep(error)
                return 0

        def on_write(_engine: int, offset: int, size: int, value: int, _data: int) -> None:
            try:
                write(offset, size, value)
            except BaseException as error:
                self._keep(error)

        functions = _READ(on_read), _WRITE(on_write)
        self._kept.append(functions)
        _check(_map_functions(self.handle, address, size, functions[0], None, functions[1], None))

    def hook_traps(self, take: Callable[[int], None]) -> None:
        """Have a function take the number of each trap."""
        self._hook(unicorn.UC_HOOK_INTR, _TRAP(lambda _engine, number, _data: take(number)))

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
        self._hook(
            kinds, _MISS(lambda _engine, kind, address, _size, _value, _data: take(kind, address))
        )

    def read(self, address: int, size: int) -> bytes:
        """Return bytes of memory; an `EngineError` says that nothing is there."""
        buffer = self._word if size <= len(self._word) else ctypes.create_string_buffer(size)
        _check(_read(self.handle, address, buffer, size))
        return buffer.raw[:size]

    def write(self, address: int, data: bytes) -> None:
        """Write bytes to memory; an `EngineError` says that nothing is there."""
        _check(_write(self.handle, address, data, len(data)))

    def start(self, address: int, count: int) -> int:
        """Do up to a number of instructions; return unicorn's number of an error, 0 for none."""
        result: int = _start(self.handle, address | 1, _NEVER, 0, count)
        if self._error is not None:
            error, self._error = self._error, None
            raise error
        return result

    def stop(self) -> None:
        """Have `start` return."""
        _stop(self.handle)

    def _keep(self, error: BaseException) -> None:
        self._error = error
        self.stop()

    def _hook(self, kinds: int, function: object, first: int = 1, last: int = 0) -> None:
        """Have unicorn call a function for a range of addresses; for all, where it ends first."""
        self._kept.append(function)
        begin, end = c_uint64(first), c_uint64(last)
        handle = c_size_t()
        _check(_add_hook(c_void_p(self.handle), byref(handle), kinds, function, None, begin, end))


_NEVER = 0xFFFF_FFFE  # an address that no program comes to
_NOP, _WFI = b"\x00\xbf", b"\x30\xbf"


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


_offset = 0


def _counter_offset() -> int:
    """Return the place in its record where unicorn counts instructions; it cannot be asked.

    Found by counting: programs of known lengths are run up to a WFI.

    Raises:
        RuntimeError: it is nowhere.
    """
    global _offset  # noqa: PLW0603 - looked for once
    if _offset:
        return _offset
    uc = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
    uc.mem_map(0, 0x3000)
    found = set(range(0, 2048, 8))
    for page, count in enumerate((1000, 37, 611)):
        uc.mem_write(page << 12, _NOP * (count - 1) + _WFI)
        uc.emu_start(page << 12 | 1, _NEVER, count=5000)
        record = ctypes.string_at(_address(uc), 2048)
        found = {at for at in found if int.from_bytes(record[at : at + 8], "little") == count}
    if not found:
        raise RuntimeError("unicorn counts instructions elsewhere than version 2.1.4")
    _offset = min(found)
    return _offset
