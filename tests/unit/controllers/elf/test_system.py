"""SysTick, NVIC and SCB by themselves, as the Armv7-M ARM, B3, has them."""

import pytest
from support.chip_core import Core

from hil_bench.abilities.controllers.elf.calls import find_calls
from hil_bench.abilities.controllers.elf.core_view import NMI, PENDSV, SYSTICK
from hil_bench.abilities.controllers.elf.peripherals.system import SystemControl

INTERRUPTS = 80
CPUID = 0x410FC241


class SystemCore(Core):
    """A core without instructions, with exceptions."""

    def __init__(self):
        super().__init__()
        self.core = self
        self.exceptions = find_calls().Exceptions(4, INTERRUPTS)
        self.vectors = 0
        self.sleeps_on_exit = self.wants_reset = False
        self.traps: dict[str, bool] = {}

    def look(self):
        pass

    def ask_for_reset(self):
        self.wants_reset = True

    def trap_divisions(self, *, is_on):
        self.traps["divisions"] = is_on

    def trap_unaligned(self, *, is_on):
        self.traps["unaligned"] = is_on


@pytest.fixture
def core():
    return SystemCore()


@pytest.fixture
def system(core):
    return SystemControl(core, CPUID, lambda: 1_000_000)


@pytest.mark.parametrize("interrupt", [0, 31, 32, 35, 79])
def test_each_interrupt_has_its_bit(system, core, interrupt):
    """ISER and ICER, ISPR and ICPR, IABR: 32 interrupts a register."""
    at, bit = interrupt // 32 * 4, 1 << interrupt % 32
    for kind, on, off in (("enabled", 0x100, 0x180), ("pending", 0x200, 0x280)):
        system.store(on + at, bit)
        assert getattr(core.exceptions, kind) >> 16 == 1 << interrupt
        assert system.load(on + at) == system.load(off + at) == bit
        system.store(on + at, 0)  # zeros write nothing
        system.store(off + at, bit << 1 & 0xFFFFFFFF)
        assert system.load(on + at) == bit
        system.store(off + at, bit)
        assert getattr(core.exceptions, kind) >> 16 == system.load(on + at) == 0
    core.exceptions.begin(16 + interrupt)
    assert system.load(0x300 + at) == bit
    core.exceptions.end()
    assert system.load(0x300 + at) == 0
    system.store(0xF00, interrupt)  # STIR
    assert core.lines == {16 + interrupt: True}


def test_an_active_line_stays_pending_and_no_interrupt_is_beyond_the_last(system, core):
    core.exceptions.hold_line(16 + 3, is_active=True)
    system.store(0x280, 1 << 3)
    assert core.exceptions.pending == 1 << 16 + 3
    system.store(0x108, 0xFFFFFFFF)  # 64 to 95, of which 64 to 79 are there
    assert core.exceptions.enabled >> 16 == 0xFFFF << 64


def test_priorities_have_a_byte_each(system, core):
    """IPR from 0x400; SHPR1 to 3 from 0xD18: exceptions 4 to 15. Four bits are there."""
    system.store(0x400 + 36, 0x9F_80_1F_30)
    assert [core.exceptions.priorities[16 + 36 + place] for place in range(4)] == [
        0x30,
        0x10,
        0x80,
        0x90,
    ]
    assert system.load(0x400 + 36) == 0x90_80_10_30
    system.store(0xD20, 0xF0_E0_00_00)
    priorities = core.exceptions.priorities
    assert (priorities[SYSTICK], priorities[PENDSV]) == (0xF0, 0xE0)
    system.store(0xD18, 0x00_40_20_10)
    assert core.exceptions.priorities[4:7] == [0x10, 0x20, 0x40]
    assert system.load(0xD20) == 0xF0E00000


def test_icsr_sets_clears_and_shows(system, core):
    exceptions = core.exceptions
    system.store(0xD04, 1 << 31 | 1 << 28 | 1 << 26)
    assert exceptions.pending == 1 << NMI | 1 << PENDSV | 1 << SYSTICK
    # VECTPENDING is that of NMI, 2; RETTOBASE is set outside of exceptions.
    assert system.load(0xD04) == 1 << 28 | 1 << 26 | NMI << 12 | 1 << 11
    exceptions.begin(NMI)
    system.store(0xD04, 1 << 27 | 1 << 25)
    assert exceptions.pending == 0
    exceptions.enabled |= 1 << 16 + 5
    exceptions.pending |= 1 << 16 + 5
    # ISRPENDING; one exception is active, NMI.
    assert system.load(0xD04) == 1 << 22 | (16 + 5) << 12 | 1 << 11 | NMI
    exceptions.begin(16 + 5)
    assert system.load(0xD04) == 16 + 5
    assert not core.wants_reset


def test_what_scb_says_and_keeps(system, core):
    assert system.load(0x04) == 2  # ICTR: 80 interrupts are three groups of 32, less one
    assert (system.load(0xD00), system.load(0x1C)) == (CPUID, 1 << 31)
    assert (system.load(0xD14), system.load(0xD0C)) == (0x200, 0xFA050000)
    system.store(0xD08, 0x0800_40FF)
    assert system.load(0xD08) == core.vectors == 0x0800_4080
    for control in (2, 0):
        system.store(0xD10, control)
        assert (system.load(0xD10), core.sleeps_on_exit) == (control, control == 2)
    for control, divisions, unaligned in ((0x10, True, False), (8, False, True)):
        system.store(0xD14, control)
        assert core.traps == {"divisions": divisions, "unaligned": unaligned}
        assert system.load(0xD14) == control | 0x200
    system.store(0xD88, 0xF << 20)  # CPACR and others are kept
    assert system.load(0xD88) == 0xF << 20
    system.store(0xD0C, 0x05FA0001)  # VECTRESET
    assert core.wants_reset
    system.reset()
    assert core.traps == {"divisions": False, "unaligned": False}
    assert [system.load(at) for at in (0xD08, 0xD10, 0xD14, 0xD88)] == [0, 0, 0x200, 0]


@pytest.mark.parametrize(("control", "period"), [(7, 1_000_000), (3, 8_000_000)])
def test_systick_counts_down_at_its_clock(system, core, control, period):
    """Bit 2 chooses the core's clock, here 1 MHz, or an eighth of it."""
    system.store(0x14, 999)
    system.store(0x10, control)
    core.run(period // 4)
    assert system.load(0x18) == 749
    core.run(period - 1)
    assert (core.lines, system.load(0x10)) == ({}, control)
    core.run(period)
    assert core.lines == {SYSTICK: True}
    assert system.load(0x10) == control | 1 << 16  # COUNTFLAG, until it is read
    assert system.load(0x10) == control
    core.run(period + period // 2)
    system.store(0x18, 1)  # any value begins anew
    assert system.load(0x18) == 999
    core.lines.clear()
    core.run(period * 5 // 2 - 1)
    assert core.lines == {}
    core.run(period * 5 // 2)
    assert core.lines == {SYSTICK: True}
    system.store(0x18, 0)
    assert system.load(0x10) == control  # COUNTFLAG is cleared as well
    core.lines.clear()
    system.store(0x10, 0)
    core.run(period * 9)
    assert (core.lines, system.load(0x18), system.load(0x10)) == ({}, 0, 0)


def test_systick_counts_without_its_exception_and_stands_at_zero(system, core):
    system.store(0x14, 0xFF00_0009)
    assert system.load(0x14) == 9
    system.store(0x10, 5)
    core.run(10_000)
    assert (core.lines, system.load(0x10)) == ({}, 5 | 1 << 16)
    system.store(0x10, 0)
    system.store(0x14, 0)
    system.store(0x10, 7)  # a reload of 0 never ticks
    core.run(1_000_000)
    assert core.lines == {}
