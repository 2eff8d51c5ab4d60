"""System control space of a Cortex-M: SysTick, NVIC, SCB (Armv7-M ARM, B3)."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from hil_bench.abilities.controllers.elf.core_view import FIRST_INTERRUPT, NMI, PENDSV, SYSTICK
from hil_bench.abilities.controllers.elf.cpu import Cpu
from hil_bench.abilities.controllers.elf.peripherals.registers import Peripheral

if TYPE_CHECKING:
    from hil_bench.abilities.controllers.elf.calls import Alarm

_ICTR, _CSR, _RVR, _CVR, _CALIB = 0x04, 0x10, 0x14, 0x18, 0x1C
_CPUID, _ICSR, _VTOR, _AIRCR, _SCR, _CCR, _STIR = 0xD00, 0xD04, 0xD08, 0xD0C, 0xD10, 0xD14, 0xF00
_SHPR1, _SHPR3 = 0xD18, 0xD20
_ENABLE, _TICKINT, _OF_CORE, _COUNTFLAG = 1, 2, 4, 1 << 16
_KEY, _KEY_READ = 0x05FA, 0xFA05
_SYSRESETREQ, _VECTRESET = 4, 1
_SLEEPONEXIT = 2
_UNALIGN_TRP, _DIV_0_TRP, _STKALIGN = 8, 0x10, 0x200


class SystemControl(Peripheral):
    """The registers at 0xE000E000.

    Args:
        cpu: the core.
        cpu_id: of CPUID.
        frequency: asks for the core's clock [Hz].
    """

    def __init__(self, cpu: Cpu, cpu_id: int, frequency: Callable[[], int]) -> None:
        self._cpu, self._core, self._exceptions = cpu, cpu.core, cpu.exceptions
        self._frequency = frequency
        self._others: dict[int, int] = {}
        self._control = self._reload = 0
        self._is_over = False
        self._begin = 0  # of the count, when it had its reload value [ns]
        self._alarm: Alarm | None = None
        self._loads: dict[int, Callable[[], int]] = {
            _ICTR: lambda: (self._exceptions.count - FIRST_INTERRUPT - 1) // 32,
            _CSR: self._systick_control,
            _RVR: lambda: self._reload,
            _CVR: self._systick_value,
            _CALIB: lambda: 1 << 31,
            _CPUID: lambda: cpu_id,
            _ICSR: self._interrupt_state,
            _VTOR: lambda: self._core.vectors,
            _AIRCR: lambda: _KEY_READ << 16 | self._exceptions.group_bits - 1 << 8,
            _CCR: lambda: self._others.get(_CCR, 0) | _STKALIGN,
        }
        self._stores: dict[int, Callable[[int], None]] = {
            _CSR: self._set_systick_control,
            _RVR: self._set_systick_reload,
            _CVR: self._set_systick_value,
            _ICSR: self._set_interrupt_state,
            _VTOR: self._set_vectors,
            _AIRCR: self._set_reset_control,
            _SCR: self._set_sleep,
            _CCR: self._set_configuration,
            _STIR: self._trigger,
        }

    def reset(self) -> None:
        """Stop SysTick; the exceptions are the core's."""
        self._others = {}
        self._control = self._reload = 0
        self._is_over = False
        self._core.vectors = 0
        self._cpu.trap_divisions(is_on=False)
        self._cpu.trap_unaligned(is_on=False)

    def load(self, offset: int) -> int:
        """Return a register."""
        if offset in self._loads:
            return self._loads[offset]()
        exceptions = self._exceptions
        block = offset >> 7
        if 2 <= block <= 6:  # ISER, ICER, ISPR, ICPR, IABR
            first = FIRST_INTERRUPT + (offset & 0x7F) * 8
            active = sum(1 << number for number in exceptions.active)
            bits = (exceptions.enabled, exceptions.pending, active)[(block - 2) // 2]
            return bits >> first & 0xFFFF_FFFF
        if 0x400 <= offset < 0x5F0:
            return self._priorities(FIRST_INTERRUPT + offset - 0x400)
        if _SHPR1 <= offset <= _SHPR3:
            return self._priorities(4 + offset - _SHPR1)
        return self._others.get(offset, 0)

    def store(self, offset: int, value: int) -> None:
        """Write a register."""
        exceptions = self._exceptions
        if offset in self._stores:
            self._stores[offset](value)
        elif 0x100 <= offset < 0x300:
            bits = value << FIRST_INTERRUPT + (offset & 0x7F) * 8
            bits &= (1 << exceptions.count) - 1
            block = (offset >> 7) - 2
            if block == 0:
                exceptions.enabled |= bits
            elif block == 1:
                exceptions.enabled &= ~bits
            elif block == 2:
                exceptions.pending |= bits
            else:
                exceptions.pending &= ~bits | exceptions.lines
            self._core.look()
        elif 0x400 <= offset < 0x5F0:
            self._set_priorities(FIRST_INTERRUPT + offset - 0x400, value)
        elif _SHPR1 <= offset <= _SHPR3:
            self._set_priorities(4 + offset - _SHPR1, value)
        else:
            self._others[offset] = value

    # NVIC and SCB.

    def _priorities(self, first: int) -> int:
        values = [value & 0xFF for value in self._exceptions.priorities[first : first + 4]]
        return int.from_bytes(bytes(values), "little")

    def _set_priorities(self, first: int, value: int) -> None:
        for place, each in enumerate(value.to_bytes(4, "little")):
            self._exceptions.set_priority(first + place, each)
        self._core.look()

    def _interrupt_state(self) -> int:
        exceptions = self._exceptions
        active = exceptions.active[-1] if exceptions.active else 0
        pending = exceptions.find_due(1 << 16)
        value = active | pending << 12
        if exceptions.pending >> PENDSV & 1:
            value |= 1 << 28
        if exceptions.pending >> SYSTICK & 1:
            value |= 1 << 26
        if exceptions.pending >> FIRST_INTERRUPT:
            value |= 1 << 22
        return value | (1 << 11 if len(exceptions.active) <= 1 else 0)

    def _set_interrupt_state(self, value: int) -> None:
        exceptions = self._exceptions
        for place, number in ((31, NMI), (28, PENDSV), (26, SYSTICK)):
            if value >> place & 1:
                exceptions.pending |= 1 << number
        for place, number in ((27, PENDSV), (25, SYSTICK)):
            if value >> place & 1:
                exceptions.pending &= ~(1 << number)
        self._core.look()

    def _set_vectors(self, value: int) -> None:
        self._core.vectors = value & ~0x7F

    def _set_reset_control(self, value: int) -> None:
        if value >> 16 != _KEY:
            return
        self._exceptions.group_bits = (value >> 8 & 7) + 1
        if value & (_SYSRESETREQ | _VECTRESET):
            self._cpu.ask_for_reset()

    def _set_sleep(self, value: int) -> None:
        self._others[_SCR] = value
        self._core.sleeps_on_exit = bool(value & _SLEEPONEXIT)

    def _set_configuration(self, value: int) -> None:
        self._others[_CCR] = value
        self._cpu.trap_divisions(is_on=bool(value & _DIV_0_TRP))
        self._cpu.trap_unaligned(is_on=bool(value & _UNALIGN_TRP))

    def _trigger(self, value: int) -> None:
        self._core.pend(FIRST_INTERRUPT + (value & 0x1FF))

    # SysTick.

    def _clock(self) -> int:
        return max(self._frequency() // (1 if self._control & _OF_CORE else 8), 1)

    def _period(self) -> int:
        return (self._reload + 1) * 1_000_000_000 // self._clock()

    def _systick_control(self) -> int:
        value = self._control | (_COUNTFLAG if self._is_over else 0)
        self._is_over = False
        return value

    def _systick_value(self) -> int:
        if not self._control & _ENABLE:
            return 0
        counted = (self._core.now() - self._begin) * self._clock() // 1_000_000_000
        return max(self._reload - counted, 0)

    def _set_systick_control(self, value: int) -> None:
        was = self._control
        self._control = value & 7
        if value & _ENABLE and (not was & _ENABLE or (was ^ value) & _OF_CORE):
            self._restart()
        elif not value & _ENABLE and self._alarm is not None:
            self._alarm.cancel()

    def _set_systick_reload(self, value: int) -> None:
        self._reload = value & 0xFF_FFFF

    def _set_systick_value(self, _value: int) -> None:
        self._is_over = False
        if self._control & _ENABLE:
            self._restart()

    def _restart(self) -> None:
        if self._alarm is not None:
            self._alarm.cancel()
        self._begin = self._core.now()
        if self._reload:
            self._alarm = self._core.alarm(self._begin + self._period(), self._tick)

    def _tick(self) -> None:
        self._begin += self._period()
        self._is_over = True
        if self._control & _TICKINT:
            self._core.pend(SYSTICK)
        self._alarm = self._core.alarm(self._begin + self._period(), self._tick)
