"""A chip with its program: memory, peripherals and buses around the core."""

import ctypes
from collections.abc import Sequence
from functools import partial
from random import Random
from typing import Any, Final

import unicorn

from hil_bench.abilities.controllers.elf.calls import find_calls
from hil_bench.abilities.controllers.elf.chips import CHIPS, FLASH, KIB, MIB, Family
from hil_bench.abilities.controllers.elf.cpu import Cpu, CpuFault
from hil_bench.abilities.controllers.elf.divisions import find_divisors
from hil_bench.abilities.controllers.elf.elf_file import read_program
from hil_bench.abilities.controllers.elf.engine import READ_EXECUTE, Engine
from hil_bench.abilities.controllers.elf.job import Job
from hil_bench.abilities.controllers.elf.peripherals.bxcan import BxCan, Filters
from hil_bench.abilities.controllers.elf.peripherals.clocks import Clocks
from hil_bench.abilities.controllers.elf.peripherals.fdcan import RAM_BYTES, Fdcan
from hil_bench.abilities.controllers.elf.peripherals.registers import Peripheral
from hil_bench.abilities.controllers.elf.peripherals.system import SystemControl
from hil_bench.abilities.controllers.elf.peripherals.timer import WATCHDOG_ADDRESS, Timer, Watchdog
from hil_bench.abilities.controllers.elf.peripherals.uart import NEW, OLD, Uart
from hil_bench.abilities.controllers.elf.wire import Wire
from hil_bench.abilities.controllers.seam import TimedFrame
from hil_bench.errors import ConfigError, ControllerError

EMPTY_RAM: Final = 0xA5
"""The bytes of memory behind power on: a program that reads what it has not set shows it."""

SHOWN_FRAMES: Final = 4
"""Frames that a fault shows."""

PAGE: Final = 0x400
"""Of memory, the least that can be mapped."""

_SYSTEM, _DEBUG, _TRACE = 0xE000_E000, 0xE004_2000, 0xE000_1000
# System memory: boot loader, unique identity, calibration; not up to where memory begins.
_IDENTITY = ((0x1FFF_0000, 32 * KIB), (0x1FFF_F400, 2 * KIB))
_LONGEST_LINE = 1000  # of what it prints; the rest is left out
_PERIPHERALS = (0x4000_0000, 0x6000_0000)
_BIT_BANDS = ((0x2000_0000, 0x2200_0000), (0x4000_0000, 0x4200_0000))
_BAND_BYTES = MIB


class Machine:
    """A chip, its program and what it has printed.

    Args:
        job: what it is.

    Attributes:
        printed: text of its UARTs, and what there is to say of it, since somebody took it.

    Raises:
        ConfigError: the program does not fit the chip.
    """

    def __init__(self, job: Job) -> None:
        self._chip = CHIPS[job.chip]
        family = self._chip.family
        self._program = read_program(job.path)
        self._path = job.path
        self._cpu = Cpu(
            family.core,
            find_calls().Exceptions(family.priority_bits, family.interrupts),
            job.instructions_per_ms,
            find_divisors(self._program.segments),
        )
        self._core = self._cpu.core
        self.printed: list[str] = []
        self._line = bytearray()
        self._bitten = ""  # by the watchdog, and why
        self._last: list[TimedFrame] = []
        self._memory: list[tuple[int, Any]] = []
        self._peripherals: dict[int, Peripheral] = {}
        self._map_memory(family)
        self._wires = self._map_peripherals(family, job)
        self._map_rest(family)
        self._cpu.engine.hook_misses(self._miss)
        self._program_flash()
        self.switch_on(0)

    @property
    def wake(self) -> int | None:
        """The time to which it sleeps unless a frame comes [ns]; None while it is awake."""
        return self._core.wake()

    def switch_on(self, now: int) -> None:
        """Give it power at a time [ns]: memory has nothing of before."""
        for _, memory in self._memory:
            ctypes.memset(memory, EMPTY_RAM, len(memory))
        self._core.set_time(now)
        self._begin()

    def advance(self, until: int, received: Sequence[TimedFrame]) -> list[TimedFrame]:
        """Let it live until a moment [ns]; return what it has sent.

        Raises:
            ControllerError: it has failed.
        """
        for time, frame in received:
            wire = self._wires[frame.bus]
            if time <= self._core.now():
                wire.bring((frame,))
            else:
                self._core.alarm(time, partial(wire.bring, (frame,)))
        try:
            self._cpu.run(until)
            while self._cpu.wants_reset:
                self._begin_again()
                self._cpu.run(until)
        except CpuFault as fault:
            raise ControllerError(self._describe(fault)) from None
        sent: list[TimedFrame] = []
        for wire in self._wires:
            if wire.sent:
                sent += wire.sent
                wire.sent = []
        if received or sent:
            self._last = [*self._last, *received, *sent][-SHOWN_FRAMES:]
        return sent

    def take_text(self) -> str:
        """Return the text that it has printed since."""
        text = "\n".join(self.printed)
        self.printed.clear()
        return text

    def _begin_again(self) -> None:
        """Reset the core, and say why."""
        reason, self._bitten = self._bitten, ""
        self._say(f"the watchdog resets it: it {reason}" if reason else "resets itself")
        self._begin()
        self._clocks.note_reset(by_watchdog=bool(reason))

    def _bite(self, reason: str) -> None:
        self._bitten = reason
        self._cpu.ask_for_reset()

    def _begin(self) -> None:
        for peripheral in self._peripherals.values():
            peripheral.reset()
        for wire in self._wires:
            wire.reset()
        self._core.vectors = FLASH
        self._cpu.reset()

    # What there is.

    def _allocate(self, address: int, size: int) -> Any:  # noqa: ANN401 - an array of ctypes
        """Map memory and return it as bytes."""
        memory = (ctypes.c_uint8 * size)()
        self._cpu.engine.map_memory(address, memory)
        return memory

    def _map_memory(self, family: Family) -> None:
        engine = self._cpu.engine
        self._flash = (ctypes.c_uint8 * self._chip.flash)()
        ctypes.memset(self._flash, 0xFF, len(self._flash))
        for address in (FLASH, 0):  # and where it is seen after boot
            engine.map_memory(address, self._flash, READ_EXECUTE)
        for address, size in self._chip.memory:
            self._memory.append((address, self._allocate(address, size)))
        for address, size in _IDENTITY:
            engine.map(address, size, READ_EXECUTE)
        engine.map(_DEBUG, PAGE)
        self._silent = [(address, self._allocate(address, size)) for address, size in family.silent]
        for address, value in family.initial.items():
            engine.write(address, value.to_bytes(4, "little"))

    def _map_peripherals(self, family: Family, job: Job) -> list[Wire]:
        cpu, core = self._cpu, self._core
        self._clocks = clocks = Clocks(family.clocks, job.crystal_hz)
        self._put(family.rcc, clocks)
        self._put(WATCHDOG_ADDRESS, Watchdog(core, clocks.watchdog_hz, self._bite))
        self._put(_SYSTEM, SystemControl(cpu, family.cpu_id, clocks.core), 4 * KIB)
        cpu.map_peripheral(
            _TRACE,
            4 * KIB,
            lambda offset, _size: (
                core.now() * clocks.core() // 10**9 & 0xFFFF_FFFF if offset == 4 else 0
            ),
            lambda _offset, _size, _value: None,
        )
        for timer in family.timers:
            frequency = partial(clocks.timer, timer.bus)
            model = Timer(core, timer.interrupt, frequency, timer.width)
            clocks.followers.append(model.follow)
            self._put(timer.address, model)
        layout = NEW if family.is_new_uart else OLD
        for address, interrupt in family.uarts.values():
            self._put(address, Uart(core, interrupt, layout, self._print))
        draw = Random(job.seed).randint  # noqa: S311 - the same at each run is meant
        delay = partial(draw, 0, job.jitter_ns) if job.jitter_ns else (lambda: 0)
        wires = {
            number: Wire(core, at, bit_ns, delay=delay)
            for at, (number, bit_ns) in enumerate(zip(job.can, job.bit_ns, strict=True))
        }
        words = None
        if family.message_ram:
            size = -(-RAM_BYTES * len(family.can) // PAGE) * PAGE
            words = self._allocate(family.message_ram, size)
            self._memory.append((family.message_ram, words))
        filters = Filters(are_shared=len(family.can) > 1)
        for number, can in enumerate(family.can, 1):
            wire = wires.get(number) or Wire(core, 0, 0)
            if words is not None:
                ram = (ctypes.c_uint32 * (RAM_BYTES // 4)).from_buffer(
                    words, RAM_BYTES * (number - 1)
                )
                self._put(can.address, Fdcan(core, wire, can.interrupts, ram))
            else:
                second = number > 1
                self._put(can.address, BxCan(core, wire, can.interrupts, filters, is_second=second))
        return [wires[number] for number in job.can]

    def _put(self, address: int, peripheral: Peripheral, size: int = PAGE) -> None:
        self._peripherals[address] = peripheral
        self._cpu.map_peripheral(address, size, peripheral.read, peripheral.write, peripheral.cells)

    def _map_rest(self, family: Family) -> None:
        if family.has_bit_band:
            for target, alias in _BIT_BANDS:
                band = _BitBand(self._cpu.engine, target, self._peripherals)
                self._cpu.map_peripheral(alias, 32 * _BAND_BYTES, band.read, band.write)
        self._names = family.names

    def _program_flash(self) -> None:
        """Flash the program.

        Raises:
            ConfigError: it does not fit the chip.
        """
        for address, data in self._program.segments:
            offset = address - FLASH if address >= FLASH else address
            if not 0 <= offset <= len(self._flash) - len(data):
                name = self._chip.name
                wrong = f"{self._path}: is linked to 0x{address:08X}, where {name} has no flash"
                raise ConfigError(f"{wrong}; build it for {name}, or name its chip")
            ctypes.memmove(ctypes.byref(self._flash, offset), data, len(data))

    # What goes wrong.

    def _miss(self, access: int, address: int) -> bool:
        """Have memory stand in for a peripheral without a model; anything else is a fault."""
        if _PERIPHERALS[0] <= address < _PERIPHERALS[1] and access != unicorn.UC_MEM_FETCH_UNMAPPED:
            page = address & ~(PAGE - 1)
            self._cpu.engine.map(page, PAGE)
            name = self._names.get(page, "a peripheral")
            self._say(f"uses {name} at 0x{page:08X}, which is memory here and does nothing")
            return True
        verbs = {
            unicorn.UC_MEM_READ_UNMAPPED: f"reads 0x{address:08X}, where nothing is",
            unicorn.UC_MEM_WRITE_UNMAPPED: f"writes to 0x{address:08X}, where nothing is",
            unicorn.UC_MEM_FETCH_UNMAPPED: f"jumps to 0x{address:08X}, where nothing is",
            unicorn.UC_MEM_WRITE_PROT: f"writes to its flash at 0x{address:08X} as to memory",
        }
        self._cpu.note_access(verbs.get(access, f"cannot reach 0x{address:08X}"))
        return False

    def _describe(self, fault: CpuFault) -> str:
        where = self._program.function_at(fault.address)
        caller = self._program.function_at(fault.caller)
        self._say(fault.registers)
        for time, frame in self._last:
            self._say(f"{time * 1e-9:.6f} s  {frame.can_id:X}#{frame.data.hex().upper()}")
        return f"hard fault in {where}, called from {caller}: {fault}"

    def _print(self, byte: int) -> None:
        if byte == 10:
            self.printed.append(self._line.decode("utf-8", "replace").rstrip("\r"))
            self._line.clear()
        elif len(self._line) < _LONGEST_LINE:
            self._line.append(byte)

    def _say(self, words: str) -> None:
        self.printed.append(f"[{self._core.now() * 1e-9:.6f} s] {words}")


class _BitBand:
    """An alias in which each word is a bit of memory or of a peripheral (Armv7-M ARM, B3.1).

    Args:
        engine: of unicorn.
        target: address of the bits.
        peripherals: those with models, by address.
    """

    def __init__(self, engine: Engine, target: int, peripherals: dict[int, Peripheral]) -> None:
        self._engine, self._target, self._peripherals = engine, target, peripherals

    def read(self, offset: int, _size: int) -> int:
        """Return a bit."""
        return self._load(self._target + (offset >> 7 << 2)) >> (offset >> 2 & 31) & 1

    def write(self, offset: int, _size: int, value: int) -> None:
        """Write a bit."""
        address, bit = self._target + (offset >> 7 << 2), 1 << (offset >> 2 & 31)
        word = self._load(address)
        word = word | bit if value & 1 else word & ~bit
        peripheral = self._peripherals.get(address & ~(PAGE - 1))
        if peripheral is not None:
            peripheral.write(address & PAGE - 1, 4, word)
        else:
            self._engine.write(address, word.to_bytes(4, "little"))

    def _load(self, address: int) -> int:
        peripheral = self._peripherals.get(address & ~(PAGE - 1))
        if peripheral is not None:
            return peripheral.read(address & PAGE - 1, 4)
        return int.from_bytes(self._engine.read(address, 4), "little")
