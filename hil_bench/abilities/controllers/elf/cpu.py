"""A Cortex-M core on unicorn: its start, and what it cannot go on after."""

from collections.abc import Callable, Iterable, Mapping
from typing import Final

import unicorn
from unicorn import arm_const as arm

from hil_bench.abilities.controllers.elf.calls import (
    DIVIDES,
    ERRORS,
    NO_EXCEPTION,
    NO_FRAME,
    NO_ROOM,
    PAUSES,
    UNALIGNED,
    Exceptions,
)
from hil_bench.abilities.controllers.elf.cells import Cells
from hil_bench.abilities.controllers.elf.core_view import FIRST_INTERRUPT, PENDSV, SVCALL, SYSTICK
from hil_bench.abilities.controllers.elf.divisions import DivisionTraps
from hil_bench.abilities.controllers.elf.engine import Engine, EngineError

MODELS: Final = {
    "Cortex-M0": arm.UC_CPU_ARM_CORTEX_M0,
    "Cortex-M3": arm.UC_CPU_ARM_CORTEX_M3,
    "Cortex-M4F": arm.UC_CPU_ARM_CORTEX_M4,
}

_THUMB = 1 << 24
_TRAPS = {
    1: "an undefined instruction",
    3: "no code here",
    4: "an access that is not aligned, or to where nothing is",
    7: "a breakpoint",
    17: "a float instruction, though the chip has none or it is off",
    18: "an instruction that is not Thumb",
    DIVIDES: "a division by zero (DIV_0_TRP in its CCR is set)",
    UNALIGNED: "reaches 0x{reached:08X}, which is not aligned",
    NO_ROOM: "no room on the stack at 0x{reached:08X} for {exception}",
    NO_EXCEPTION: "a return from an exception where there is none",
    NO_FRAME: "nothing on the stack at 0x{reached:08X} to return to",
    ERRORS + unicorn.UC_ERR_INSN_INVALID: "an undefined instruction",
}


def _numbers(names: Iterable[str]) -> tuple[int, ...]:
    """Return unicorn's numbers of registers."""
    return tuple(getattr(arm, f"UC_ARM_REG_{name}") for name in names)


# The mode first: it says which stack pointer the SP is.
_BEGIN = _numbers(("XPSR", "CONTROL", "SP", "R0", "R1", "R2", "R3", "R12", "LR"))
_SHOWN = (*(f"R{number}" for number in range(13)), "SP", "LR", "PC", "XPSR")
_NAMES = {SVCALL: "SVCall", PENDSV: "PendSV", SYSTICK: "SysTick"}


class CpuFault(Exception):  # noqa: N818 - what a core calls it
    """The program did what a core cannot go on after.

    Args:
        what: it did, in words.
        address: of the instruction.
        caller: the address in LR.
        registers: a line of all registers.
    """

    def __init__(self, what: str, address: int, caller: int, registers: str) -> None:
        super().__init__(what)
        self.address, self.caller, self.registers = address, caller, registers


class Cpu:
    """The core of a chip.

    Args:
        model: of `MODELS`.
        exceptions: that it has.
        per_ms: instructions that it does in a millisecond.
        divisors: of its program; see `DivisionTraps`.

    Attributes:
        engine: of unicorn, for what is mapped.
        core: what its peripherals know of it.
        divisions: those by zero, as traps.
        exceptions: their state.
        wants_reset: whether the program has asked for a reset.
    """

    def __init__(
        self, model: str, exceptions: Exceptions, per_ms: int, divisors: Mapping[int, int]
    ) -> None:
        self._has_masks = model != "Cortex-M0"
        self.engine = engine = Engine(
            MODELS[model],
            per_ms,
            exceptions,
            has_masks=self._has_masks,
            has_floats=model == "Cortex-M4F",
        )
        self.core = engine.core
        self.divisions = DivisionTraps(engine, divisors, self._divide)
        self.exceptions = exceptions
        self.wants_reset = False
        self._access = ""
        masks = ("PRIMASK", "BASEPRI", "FAULTMASK") if self._has_masks else ("PRIMASK",)
        self._masks = engine.registers(_numbers(masks))
        self._shown = engine.registers(_numbers(_SHOWN))
        self.trap_unaligned(is_on=False)

    def ask_for_reset(self) -> None:
        """Stop behind the write that asks for it; see `wants_reset`."""
        self.wants_reset = True
        self.core.pause()

    def trap_divisions(self, *, is_on: bool) -> None:
        """Have divisions by zero be traps, from behind the write that says so."""
        self.divisions.is_on = is_on
        if self.divisions.are_due:
            self.core.pause()

    def trap_unaligned(self, *, is_on: bool) -> None:
        """Have each access that is not aligned be a trap; on a Cortex-M0 they always are."""
        self.core.traps_all = is_on or not self._has_masks

    def map_peripheral(
        self,
        address: int,
        size: int,
        read: Callable[[int, int], int],
        write: Callable[[int, int, int], None],
        cells: Cells | None = None,
    ) -> None:
        """Have functions answer for a range of addresses.

        Args:
            address: of its first byte.
            size: of the range.
            read: of offset and size gives the value.
            write: of offset, size and value takes it.
            cells: registers that need no function.
        """
        self.engine.map_functions(address, size, read, write, cells)

    def note_access(self, words: str) -> None:
        """Keep what is known of an access that fails."""
        self._access = words

    def reset(self) -> None:
        """Begin at the reset vector; the time goes on."""
        self.exceptions.reset()
        self.wants_reset = False
        stack, start = (self._word(self.core.vectors + at) for at in (0, 4))
        self.core.begin(start)
        begin = self.engine.registers(_BEGIN)
        begin.write((_THUMB, 0, stack & ~3, 0, 0, 0, 0, 0, 0xFFFF_FFFF))
        self._masks.write([0] * (3 if self._has_masks else 1))

    def run(self, until: int) -> None:
        """Live until a moment [ns], or a reset; a `CpuFault` says that it cannot."""
        while not self.wants_reset and (why := self.core.live(until)):
            if why != PAUSES:
                raise self._fault(why)
            if self.divisions.are_due:
                self.divisions.hook()

    def _divide(self, register: int) -> None:
        if not self._shown.read()[register]:
            self.core.trap(DIVIDES)

    def _word(self, address: int) -> int:
        return int.from_bytes(self.engine.read(address, 4), "little")

    def _fault(self, why: int) -> CpuFault:
        core, access, self._access = self.core, self._access, ""
        words = access if why > 0 and access else _words(why)
        what = words.format(reached=core.reached, exception=_name(core.number))
        values = dict(zip(_SHOWN, self._shown.read(), strict=True))
        values["PC"] = core.at
        registers = " ".join(f"{name}={value:08X}" for name, value in values.items())
        return CpuFault(what, values["PC"], values["LR"] & ~1, registers)


def _words(why: int) -> str:
    """Return the reason for which a start has ended, in words."""
    other = str(EngineError(why - ERRORS)) if why > ERRORS else f"exception {why} of the simulator"
    return _TRAPS.get(why, other)


def _name(number: int) -> str:
    if number >= FIRST_INTERRUPT:
        return f"interrupt {number - FIRST_INTERRUPT}"
    return _NAMES.get(number, f"exception {number}")
