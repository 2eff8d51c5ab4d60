"""A Cortex-M core on unicorn, with what unicorn lacks: exceptions, sleep and time."""

from collections.abc import Callable, Iterable, Mapping
from typing import Final

import unicorn
from unicorn import arm_const as arm

from hil_bench.abilities.controllers.elf.calls import DIVIDES, ERRORS, SLEEPS, UNALIGNED, WAITS
from hil_bench.abilities.controllers.elf.cells import Cells
from hil_bench.abilities.controllers.elf.divisions import DivisionTraps
from hil_bench.abilities.controllers.elf.engine import Engine, EngineError
from hil_bench.abilities.controllers.elf.nvic import (
    FIRST_INTERRUPT,
    PENDSV,
    SVCALL,
    SYSTICK,
    Exceptions,
)
from hil_bench.abilities.controllers.elf.timeline import Alarm, Timeline

MODELS: Final = {
    "Cortex-M0": arm.UC_CPU_ARM_CORTEX_M0,
    "Cortex-M3": arm.UC_CPU_ARM_CORTEX_M3,
    "Cortex-M4F": arm.UC_CPU_ARM_CORTEX_M4,
}

MASKED_STEP = 16
"""Instructions after which the masks are looked at, where they alone hold an exception back."""

_THUMB = 1 << 24
_CALL, _RETURN = 2, 8  # unicorn's numbers of an SVC and of a branch to EXC_RETURN
_TRAPS = {
    1: "an undefined instruction",
    3: "no code here",
    4: "an access that is not aligned, or to where nothing is",
    7: "a breakpoint",
    17: "a float instruction, though the chip has none or it is off",
    18: "an instruction that is not Thumb",
    DIVIDES: "a division by zero (DIV_0_TRP in its CCR is set)",
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
        divisions: those by zero, as traps.
        exceptions: their state.
        vectors: address of their table.
        sleeps_on_exit: whether it sleeps when the last exception is over.
        wants_reset: whether the program has asked for a reset.
    """

    def __init__(
        self, model: str, exceptions: Exceptions, per_ms: int, divisors: Mapping[int, int]
    ) -> None:
        self._has_masks = model != "Cortex-M0"
        self.engine = engine = Engine(
            MODELS[model], per_ms, has_masks=self._has_masks, has_floats=model == "Cortex-M4F"
        )
        self.divisions = DivisionTraps(engine, divisors, self._divide)
        self.exceptions = exceptions
        self.vectors = 0
        self.sleeps_on_exit = self.wants_reset = False
        self._per_ms = per_ms
        self._timeline = Timeline()
        self._end = 0
        self._is_asleep = self._has_event = False
        self._access = ""
        self._core = core = engine.core
        self.now: Callable[[], int] = core.now
        masks = ("PRIMASK", "BASEPRI", "FAULTMASK") if self._has_masks else ("PRIMASK",)
        self._masks = engine.registers(_numbers(masks))
        self._shown = engine.registers(_numbers(_SHOWN))
        self.trap_unaligned(is_on=False)

    def alarm(self, time: int, action: Callable[[], None]) -> Alarm:
        """Have something happen at a time [ns], in the middle of what runs if need be."""
        alarm = self._timeline.add(time, action)
        if time < self._end:
            self._core.interrupt()
        return alarm

    def pend(self, exception: int) -> None:
        """Make an exception pending."""
        self.exceptions.pending |= 1 << exception
        self.look()

    def hold_line(self, interrupt: int, *, is_active: bool) -> None:
        """Set the level of an interrupt's line: pending again for as long as it is active."""
        self.exceptions.hold_line(FIRST_INTERRUPT + interrupt, is_active=is_active)
        if is_active:
            self.look()

    def look(self) -> None:
        """Have the core look for exceptions behind the write that it is doing."""
        if self.exceptions.pending & self.exceptions.enabled:
            self._core.interrupt()

    def ask_for_reset(self) -> None:
        """Stop behind the write that asks for it; see `wants_reset`."""
        self.wants_reset = True
        self._core.interrupt()

    def trap_divisions(self, *, is_on: bool) -> None:
        """Have divisions by zero be traps, from behind the write that says so."""
        self.divisions.is_on = is_on
        if self.divisions.are_due:
            self._core.interrupt()

    def trap_unaligned(self, *, is_on: bool) -> None:
        """Have each access that is not aligned be a trap; on a Cortex-M0 they always are."""
        self._core.traps_all = is_on or not self._has_masks

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
        self._core.set_time(self.now())
        self._timeline.clear()
        self.exceptions.reset()
        self.sleeps_on_exit = self.wants_reset = False
        self._is_asleep = self._has_event = False
        stack, start = (self._word(self.vectors + at) for at in (0, 4))
        self._core.at = start & ~1
        begin = self.engine.registers(_BEGIN)
        begin.write((_THUMB, 0, stack & ~3, 0, 0, 0, 0, 0, 0xFFFF_FFFF))
        self._masks.write([0] * (3 if self._has_masks else 1))

    def jump_to(self, time: int) -> None:
        """Set the clock of a core that has not run yet [ns]."""
        self._core.set_time(time)

    def run(self, until: int) -> None:
        """Live until a moment [ns]; a `CpuFault` says that it cannot."""
        exceptions = self.exceptions
        while True:
            now = self.now()
            self._timeline.fire(now)
            if self.wants_reset:
                return
            step = 0
            if exceptions.pending & exceptions.enabled:
                step = self._preempt()
            if now >= until:
                return
            if self.divisions.are_due:
                self.divisions.hook()
            end = self._timeline.next_time(until)
            if self._is_asleep:
                self._core.set_time(end)
                continue
            self._execute(now, end, step)

    @property
    def wake(self) -> int | None:
        """The time to which it sleeps unless something comes from outside [ns]; None awake."""
        return self._timeline.next_time(1 << 62) if self._is_asleep else None

    # What runs.

    def _execute(self, now: int, end: int, most: int) -> None:
        """Run until `end` [ns], or fewer instructions where `most` is not 0."""
        count = -((now - end) * self._per_ms // 1_000_000) or 1
        if most and most < count:
            count = most
        self._end = end
        why = self._core.start(count)
        if not why:
            return
        if why == SLEEPS:
            self._is_asleep = True
        elif why == WAITS:
            self._is_asleep, self._has_event = not self._has_event, False
        elif why == _RETURN:
            self._leave()
        elif why == _CALL:
            self._enter(SVCALL)
        elif why == UNALIGNED:
            raise self._fault(f"reaches 0x{self._core.reached:08X}, which is not aligned")
        else:
            raise self._fault(self._access or _words(why))

    def _divide(self, register: int) -> None:
        if not self._shown.read()[register]:
            self._core.trap(DIVIDES)

    def _word(self, address: int) -> int:
        return int.from_bytes(self.engine.read(address, 4), "little")

    def _fault(self, what: str) -> CpuFault:
        self._access = ""
        values = dict(zip(_SHOWN, self._shown.read(), strict=True))
        values["PC"] = self._core.at
        registers = " ".join(f"{name}={value:08X}" for name, value in values.items())
        return CpuFault(what, values["PC"], values["LR"] & ~1, registers)

    # Exceptions.

    def _ceiling(self, ceiling: int) -> int:
        """Return the priority that an exception has to be below, by a priority and the masks."""
        primask, *others = self._masks.read()
        if primask & 1:
            ceiling = min(ceiling, 0)
        if others:
            basepri, faultmask = others
            if basepri:
                ceiling = min(ceiling, self.exceptions.group_of(basepri))
            if faultmask & 1:
                ceiling = min(ceiling, -1)
        return ceiling

    def _preempt(self) -> int:
        """Enter the exception that is due; return a number of instructions to look again after."""
        exceptions = self.exceptions
        priority = exceptions.priority
        number = exceptions.find_due(priority)
        if not number:
            return 0
        self._is_asleep = False
        ceiling = self._ceiling(priority)
        if ceiling < priority:
            number = exceptions.find_due(ceiling)
            if not number:
                return MASKED_STEP
        self._enter(number)
        return 0

    def _enter(self, number: int) -> None:
        """Stack what an exception may change, and go to its function."""
        top = self._core.enter(number, self.vectors)
        if top is not None:
            raise self._fault(f"no room on the stack at 0x{top:08X} for {_name(number)}")
        self.exceptions.begin(number)
        self._has_event = True

    def _leave(self) -> None:
        """End the exception that runs: enter the next one, or go back to what it interrupted."""
        exceptions = self.exceptions
        if not exceptions.active:
            raise self._fault("a return from an exception where there is none")
        exceptions.end()
        self._core.end_exception()
        self._has_event = True
        if exceptions.pending & exceptions.enabled:
            number = exceptions.find_due(self._ceiling(exceptions.priority))
            if number:
                exceptions.begin(number)
                self._core.chain(number, self.vectors)
                return
        stack = self._core.leave()
        if stack is not None:
            raise self._fault(f"nothing on the stack at 0x{stack:08X} to return to")
        if self.sleeps_on_exit and not exceptions.active:
            self._is_asleep = True


def _words(why: int) -> str:
    """Return the reason for which a start has ended, in words."""
    other = str(EngineError(why - ERRORS)) if why > ERRORS else f"exception {why} of the simulator"
    return _TRAPS.get(why, other)


def _name(number: int) -> str:
    if number >= FIRST_INTERRUPT:
        return f"interrupt {number - FIRST_INTERRUPT}"
    return _NAMES.get(number, f"exception {number}")
