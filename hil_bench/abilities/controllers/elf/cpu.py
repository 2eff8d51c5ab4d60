"""A Cortex-M core on unicorn, with what unicorn lacks: exceptions, sleep and time."""

from collections.abc import Callable, Iterable, Mapping
from struct import Struct
from typing import Final

from unicorn import arm_const as arm

from hil_bench.abilities.controllers.elf.divisions import DivisionTraps
from hil_bench.abilities.controllers.elf.engine import (
    INVALID_INSTRUCTION,
    Engine,
    EngineError,
)
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

_BASIC, _EXTENDED = Struct("<8I"), Struct("<26I")
_EXC_RETURN, _TO_THREAD, _FROM_PSP, _NO_FLOATS = 0xFFFF_FFE1, 8, 4, 16
_SPSEL, _FPCA = 2, 4
_THUMB = 1 << 24
_PADDED = 1 << 9
_IPSR = 0x1FF
_WFI, _WFE = b"\x30\xbf", b"\x20\xbf"
_CALL, _RETURN = 2, 8  # unicorn's numbers of an SVC and of a branch to EXC_RETURN
_DIVISION, _UNALIGNED = -1, -2  # our own
_TRAPS = {
    1: "an undefined instruction",
    3: "no code here",
    4: "an access that is not aligned, or to where nothing is",
    7: "a breakpoint",
    17: "a float instruction, though the chip has none or it is off",
    18: "an instruction that is not Thumb",
    _DIVISION: "a division by zero (DIV_0_TRP in its CCR is set)",
    _UNALIGNED: "an access that is not aligned",
}


def _numbers(names: Iterable[str]) -> tuple[int, ...]:
    """Return unicorn's numbers of registers."""
    return tuple(getattr(arm, f"UC_ARM_REG_{name}") for name in names)


_FRAME = ("R0", "R1", "R2", "R3", "R12", "LR", "PC")
_SAVED = _numbers((*_FRAME, "XPSR", "SP", "CONTROL"))
# The mode first: it says which stack pointer the SP is.
_RESTORED = _numbers(("XPSR", "CONTROL", "SP", *_FRAME))
_ENTERED = _numbers(("SP", "XPSR", "CONTROL", "LR", "PC"))
_CHAINED = _numbers(("XPSR", "LR", "PC"))
_FLOATS = (*range(arm.UC_ARM_REG_S0, arm.UC_ARM_REG_S0 + 16), arm.UC_ARM_REG_FPSCR)
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
        self.engine = engine = Engine(MODELS[model], self._take_unaligned)
        self.divisions = DivisionTraps(engine, divisors, self._divide)
        self._has_masks = model != "Cortex-M0"
        self._has_floats = model == "Cortex-M4F"
        self.exceptions = exceptions
        self.vectors = 0
        self.sleeps_on_exit = self.wants_reset = False
        self._per_ms = per_ms
        self._timeline = Timeline()
        self._epoch = self._done = self._end = 0
        self._is_running = self._is_asleep = self._has_event = False
        self._must_repeat = self._is_repeating = False
        self._trap = 0
        self._access = ""
        self._instructions = engine.instructions
        self._at = 0  # where it goes on
        self._pc = engine.registers((arm.UC_ARM_REG_PC,))
        self._saved = engine.registers(_SAVED)
        self._restored = engine.registers(_RESTORED)
        self._entered = engine.registers(_ENTERED)
        self._chained = engine.registers(_CHAINED)
        self._floats = engine.registers(_FLOATS)
        masks = ("PRIMASK", "BASEPRI", "FAULTMASK") if self._has_masks else ("PRIMASK",)
        self._masks = engine.registers(_numbers(masks))
        self._stacks = engine.registers(_numbers(("MSP", "PSP", "CONTROL")))
        self._shown = engine.registers(_numbers(_SHOWN))
        engine.hook_traps(self._take_trap)
        self.trap_unaligned(is_on=False)

    def now(self) -> int:
        """Return the time, to the instruction [ns]."""
        done = self._done + self._instructions.count if self._is_running else self._done
        return self._epoch + done * 1_000_000 // self._per_ms

    def alarm(self, time: int, action: Callable[[], None]) -> Alarm:
        """Have something happen at a time [ns], in the middle of what runs if need be."""
        alarm = self._timeline.add(time, action)
        if self._is_running and time < self._end:
            self._interrupt()
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
        if self._is_running and self.exceptions.pending & self.exceptions.enabled:
            self._interrupt()

    def ask_for_reset(self) -> None:
        """Stop behind the write that asks for it; see `wants_reset`."""
        self.wants_reset = True
        if self._is_running:
            self._interrupt()

    def trap_divisions(self, *, is_on: bool) -> None:
        """Have divisions by zero be traps, from behind the write that says so."""
        self.divisions.is_on = is_on
        if self._is_running and self.divisions.are_due:
            self._interrupt()

    def trap_unaligned(self, *, is_on: bool) -> None:
        """Have each access that is not aligned be a trap; on a Cortex-M0 they always are."""
        self._instructions.traps_all = is_on or not self._has_masks

    def map_peripheral(
        self,
        address: int,
        size: int,
        read: Callable[[int, int], int],
        write: Callable[[int, int, int], None],
    ) -> None:
        """Have functions answer for a range of addresses.

        Args:
            address: of its first byte.
            size: of the range.
            read: of offset and size gives the value.
            write: of offset, size and value takes it.
        """

        def write_once(offset: int, size: int, value: int) -> None:
            if not self._is_repeating:
                write(offset, size, value)

        self.engine.map_functions(address, size, read, write_once)

    def note_access(self, words: str) -> None:
        """Keep what is known of an access that fails."""
        self._access = words

    def reset(self) -> None:
        """Begin at the reset vector; the time goes on."""
        self._epoch, self._done = self.now(), 0
        self._timeline.clear()
        self.exceptions.reset()
        self.sleeps_on_exit = self.wants_reset = False
        self._is_asleep = self._has_event = False
        stack, start = (self._word(self.vectors + at) for at in (0, 4))
        self._at = start & ~1
        self._restored.write((_THUMB, 0, stack & ~3, 0, 0, 0, 0, 0, 0xFFFF_FFFF, self._at))
        self._masks.write([0] * (3 if self._has_masks else 1))

    def jump_to(self, time: int) -> None:
        """Set the clock of a core that has not run yet [ns]."""
        self._epoch, self._done = time, 0

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
                self._epoch, self._done = end, 0
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
        done = self._start(count)
        if self._must_repeat:
            self._must_repeat = False
            self._done -= 1  # counted already
            self._is_repeating = True
            self._start(1)
            self._is_repeating = False
        if self._trap:
            trap, self._trap = self._trap, 0
            if trap == _RETURN:
                self._leave()
            elif trap == _CALL:
                self._enter(SVCALL)
            else:
                why = _TRAPS.get(trap, f"exception {trap} of the simulator")
                raise self._fault(self._access or why)
        elif done < count and self._code(self._at - 2) == _WFI:
            self._is_asleep = True

    def _start(self, count: int) -> int:
        """Do a number of instructions; return how many were done."""
        self._is_running = True
        error = self._instructions.start(self._at, count)
        self._is_running = False
        self._at = self._pc.read()[0]
        done = min(self._instructions.count, count)  # the one that it stops at is counted
        self._done += done
        if error and not self._trap:
            if error == INVALID_INSTRUCTION and self._code(self._at - 2) == _WFE:
                self._is_asleep, self._has_event = not self._has_event, False
            else:
                undefined = _TRAPS[1] if error == INVALID_INSTRUCTION else str(EngineError(error))
                raise self._fault(self._access or undefined)
        return done

    def _interrupt(self) -> None:
        """Have the core come back behind the instruction that writes to a peripheral now.

        Unicorn stops in front of it, so it is done again, without an effect.
        """
        if not self._is_repeating and not self._must_repeat:
            self._must_repeat = True
            self.engine.stop()

    def _take_trap(self, number: int) -> None:
        self._trap = number
        self.engine.stop()

    def _take_unaligned(self, address: int) -> None:
        self._access = f"reaches 0x{address:08X}, which is not aligned"
        self._take_trap(_UNALIGNED)

    def _divide(self, register: int) -> None:
        if not self._shown.read()[register]:
            self._take_trap(_DIVISION)

    def _code(self, address: int) -> bytes:
        try:
            return self.engine.read(address, 2)
        except EngineError:
            return b""

    def _word(self, address: int) -> int:
        return int.from_bytes(self.engine.read(address, 4), "little")

    def _fault(self, what: str) -> CpuFault:
        self._access = ""
        values = dict(zip(_SHOWN, self._shown.read(), strict=True))
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

    def _vector(self, number: int) -> int:
        return self._word(self.vectors + 4 * number) & ~1

    def _enter(self, number: int) -> None:
        """Stack what an exception may change, and go to its function."""
        *frame, sp, control = self._saved.read()
        status = frame[-1]
        has_floats = self._has_floats and control & _FPCA
        back = _EXC_RETURN | (0 if has_floats else _NO_FLOATS)
        if not status & _IPSR:
            back |= _TO_THREAD
            if control & _SPSEL:
                back |= _FROM_PSP
        if sp & 4:
            frame[-1] |= _PADDED
        if has_floats:
            stacked = _EXTENDED.pack(*frame, *self._floats.read(), 0)
        else:
            stacked = _BASIC.pack(*frame)
        top = (sp - len(stacked)) & ~7
        try:
            self.engine.write(top, stacked)
        except EngineError:
            words = f"no room on the stack at 0x{top:08X} for {_name(number)}"
            raise self._fault(words) from None
        self.exceptions.begin(number)
        self._has_event = True
        control &= ~(_SPSEL | _FPCA)
        self._at = self._vector(number)
        self._entered.write((top, _THUMB | number, control, back, self._at))

    def _leave(self) -> None:
        """End the exception that runs: enter the next one, or go back to what it interrupted."""
        exceptions = self.exceptions
        back = self._at | 1
        if not exceptions.active:
            raise self._fault("a return from an exception where there is none")
        exceptions.end()
        if self._has_masks:
            primask, basepri, faultmask = self._masks.read()
            if faultmask:
                self._masks.write((primask, basepri, 0))
        self._has_event = True
        if exceptions.pending & exceptions.enabled:
            number = exceptions.find_due(self._ceiling(exceptions.priority))
            if number:
                exceptions.begin(number)
                self._at = self._vector(number)
                self._chained.write((_THUMB | number, back, self._at))
                return
        is_psp = back & _FROM_PSP
        main, process, control = self._stacks.read()
        sp = process if is_psp else main
        layout = _BASIC if back & _NO_FLOATS else _EXTENDED
        try:
            stacked = layout.unpack(self.engine.read(sp, layout.size))
        except EngineError:
            raise self._fault(f"nothing on the stack at 0x{sp:08X} to return to") from None
        status = stacked[7]
        sp += layout.size + (4 if status & _PADDED else 0)
        control &= ~(_SPSEL | _FPCA)
        if is_psp:
            control |= _SPSEL
        if not back & _NO_FLOATS:
            control |= _FPCA
            self._floats.write(stacked[8:25])
        self._at = stacked[6]
        self._restored.write((status & ~_PADDED | _THUMB, control, sp, *stacked[:7]))
        if self.sleeps_on_exit and not exceptions.active:
            self._is_asleep = True


def _name(number: int) -> str:
    if number >= FIRST_INTERRUPT:
        return f"interrupt {number - FIRST_INTERRUPT}"
    return _NAMES.get(number, f"exception {number}")
