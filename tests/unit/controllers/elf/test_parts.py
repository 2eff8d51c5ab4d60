"""Parts of a chip by themselves: filters, FIFOs, arbitration, priorities, files.

Expected values follow from the reference manuals: RM0090 (bxCAN), RM0440 (FDCAN), and the Armv7-M
Architecture Reference Manual (priorities).
"""

import itertools
import os
import struct
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from hil_bench.abilities.controllers.elf.chips import CHIPS, FAMILIES, find_chip
from hil_bench.abilities.controllers.elf.elf_file import read_program
from hil_bench.abilities.controllers.elf.nvic import PENDSV, SYSTICK, THREAD_PRIORITY, Exceptions
from hil_bench.abilities.controllers.elf.peripherals import clocks as trees
from hil_bench.abilities.controllers.elf.peripherals.bxcan import BxCan, Filters
from hil_bench.abilities.controllers.elf.peripherals.clocks import Clocks
from hil_bench.abilities.controllers.elf.peripherals.fdcan import Fdcan
from hil_bench.abilities.controllers.elf.peripherals.timer import Timer
from hil_bench.abilities.controllers.elf.timeline import Alarm, Timeline
from hil_bench.abilities.controllers.elf.wire import Wire
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import ConfigError

OWN = range(14)


class Core:
    """A core without instructions: time passes by `run`."""

    def __init__(self) -> None:
        self.time = 0
        self.lines: dict[int, bool] = {}
        self._timeline = Timeline()

    def now(self) -> int:
        return self.time

    def alarm(self, time: int, action: Callable[[], None]) -> Alarm:
        return self._timeline.add(time, action)

    def pend(self, exception: int) -> None:
        self.lines[exception] = True

    def hold_line(self, interrupt: int, *, is_active: bool) -> None:
        self.lines[interrupt] = is_active

    def run(self, until: int) -> None:
        while (time := self._timeline.next_time(until + 1)) <= until:
            self.time = max(time, self.time)
            self._timeline.fire(self.time)
        self.time = until


def test_a_wide_mask_and_a_list_of_narrow_ones() -> None:
    filters = Filters()
    filters.store(0x20C, 0b01)  # bank 0 wide
    filters.store(0x204, 0b10)  # bank 1 a list, narrow
    filters.store(0x214, 0b10)  # bank 1 into FIFO 1
    filters.store(0x240, 0x180 << 21)
    filters.store(0x244, 0x780 << 21)
    filters.store(0x248, 0x701 << 5 | (0x702 << 5) << 16)
    filters.store(0x24C, 0x703 << 5 | (0x704 << 5) << 16)
    filters.store(0x21C, 0b11)
    filters.store(0x200, 0xE00)
    assert filters.match(Frame(0x181), OWN) == (0, 0)
    assert filters.match(Frame(0x703), OWN) == (1, 2)
    assert filters.match(Frame(0x705), OWN) is None
    assert filters.match(Frame(0x701, is_remote=True), OWN) is None


def test_of_two_filters_the_wider_and_then_the_list_wins() -> None:
    filters = Filters()
    filters.store(0x20C, 0b110)  # banks 1 and 2 wide
    filters.store(0x204, 0b100)  # bank 2 a list
    filters.store(0x21C, 0b111)
    for offset in (0x240, 0x244, 0x248, 0x24C):
        filters.store(offset, 0)  # masks that let all in
    filters.store(0x250, 0x123 << 21)
    filters.store(0x200, 0xE00)
    # Bank 0 has the numbers 0 and 1, bank 1 the number 2, bank 2 the numbers 3 and 4.
    assert filters.match(Frame(0x123), OWN) == (0, 3)
    assert filters.match(Frame(0x124), OWN) == (0, 2)


def bxcan(bit_ns: int) -> tuple[Core, Wire, BxCan]:
    core = Core()
    wire = Wire(core, 0, bit_ns)
    can = BxCan(core, wire, (19, 20, 21, 22), Filters())
    for offset, value in ((0x20C, 1), (0x21C, 1), (0x200, 0x2A1C0E00), (0x14, 0x13), (0x00, 0)):
        can.store(offset, value)
    return core, wire, can


@pytest.mark.parametrize(("control", "kept"), [(0, [1, 2, 4]), (8, [1, 2, 3])])
def test_a_full_fifo_loses_a_frame_on_copper(control: int, kept: list[int]) -> None:
    core, wire, can = bxcan(1000)
    can.store(0x00, control)  # RFLM: the FIFO keeps what it has
    wire.bring([Frame(number) for number in (1, 2, 3, 4)])
    core.run(1_000_000)
    assert can.load(0x0C) == 3 | 8 | 16  # full, and overrun
    got = []
    for _ in range(3):
        got.append(can.load(0x1B0) >> 21)
        can.store(0x0C, 32)
    assert got == kept


@pytest.mark.parametrize("number", [1, 2])
def test_a_waiting_frame_can_be_taken_back(number: int) -> None:
    """ABRQ of its mailbox: RQCP without TXOK, and the mailbox is empty (RM0090, CAN_TSR)."""
    core, wire, can = bxcan(1000)
    for mailbox in range(3):
        at = 0x180 + 16 * mailbox
        can.store(at + 4, 0)
        can.store(at, 0x100 + mailbox << 21 | 1)
    can.store(0x08, 0x80 << 8 * number)
    assert can.load(0x08) >> 8 * number & 3 == 1
    assert can.load(0x08) >> 26 == 1 << number
    core.run(1_000_000)
    sent = [frame.can_id for _, frame in wire.sent]
    assert sent == [0x100 + mailbox for mailbox in range(3) if mailbox != number]


def test_a_full_fifo_holds_frames_back_on_a_bus_without_time() -> None:
    core, wire, can = bxcan(0)
    wire.bring([Frame(number) for number in range(1, 6)])
    core.run(1_000_000)
    got = []
    while can.load(0x0C) & 3:
        got.append(can.load(0x1B0) >> 21)
        can.store(0x0C, 32)
        core.run(core.time + 100_000)
    assert got == [1, 2, 3, 4, 5]
    assert not can.load(0x0C) & 16


def test_frames_of_a_bus_without_time_come_as_the_shortest_do_on_a_wire() -> None:
    core, wire, _ = bxcan(0)
    times = []
    wire.receive = lambda _: bool(times.append(core.time) or True)
    wire.bring([Frame(1), Frame(2), Frame(3)])
    core.run(1_000_000)
    assert times == [0, 50_000, 100_000]  # 47 bits at 1 Mbit/s, rounded up


def test_a_timer_counts_to_its_compare_and_its_end() -> None:
    core = Core()
    timer = Timer(core, 28, lambda: 8_000_000)
    for offset, value in (
        (0x28, 7),
        (0x2C, 99),
        (0x34, 40),
        (0x14, 1),
        (0x10, 0),
        (0x0C, 3),
        (0, 1),
    ):
        timer.store(offset, value)
    # 8 MHz / 8 counts microseconds, 0 to 99.
    for until, flags, count in ((39_999, 0, 39), (40_000, 2, 40), (99_999, 2, 99), (100_000, 3, 0)):
        core.run(until)
        assert (timer.load(0x10) & 3, timer.load(0x24)) == (flags, count)
    assert core.lines[28]
    timer.store(0x10, 0)
    assert not core.lines[28]
    timer.store(0, 0)
    core.run(500_000)
    assert (timer.load(0x10), timer.load(0x24)) == (0, 0)


def test_a_timer_of_one_pulse_stands_before_it_and_behind_it() -> None:
    core = Core()
    timer = Timer(core, 28, lambda: 8_000_000)
    for offset, value in ((0x28, 7), (0x2C, 299), (0x14, 1), (0x10, 0)):
        timer.store(offset, value)
    # 8 MHz / 8 counts microseconds, 0 to 299; OPM ends it at the update (RM0090, 18.3.10).
    for begin in (50_000, 1_000_000):
        core.run(begin)
        assert timer.read(0x24, 4) == 0
        timer.store(0, 9)
        core.run(begin + 299_999)
        assert [timer.read(0x24, size) for size in (4, 2, 1)] == [299, 299, 299 & 0xFF]
        core.run(begin + 450_000)
        assert (timer.read(0x24, 4), timer.load(0)) == (0, 8)


def test_a_timer_loses_no_time_while_its_compare_is_written() -> None:
    core = Core()
    timer = Timer(core, 28, lambda: 8_000_000, width=32)
    for offset, value in ((0x28, 7), (0x14, 1), (0, 1)):
        timer.store(offset, value)
    for _ in range(1000):
        core.run(core.time + 700)
        timer.store(0x34, timer.load(0x24) + 100)
    # 8 MHz / 8 counts microseconds: 1000 times 0.7 us.
    assert timer.load(0x24) == 700


def test_the_least_identifier_goes_first_unless_in_order_of_request() -> None:
    for control, order in ((0, [0x300, 0x100, 0x200]), (4, [0x300, 0x200, 0x100])):
        core, wire, can = bxcan(1000)
        can.store(0x00, control)
        for number, can_id in enumerate((0x300, 0x200, 0x100)):  # the first is on the bus at once
            can.store(0x180 + 16 * number, can_id << 21 | 1)
        assert can.load(0x08) >> 26 & 7 == 0
        core.run(1_000_000)
        assert [frame.can_id for _, frame in wire.sent] == order
        assert can.load(0x08) & 0x1C030303 == 0x1C030303  # all empty, done and well
        assert core.lines[19]


def test_the_lesser_identifier_wins_the_bus() -> None:
    core, wire, can = bxcan(1000)
    wire.bring([Frame(0x400), Frame(0x080)])
    can.store(0x180, 0x200 << 21 | 1)
    core.run(1_000_000)
    # 0x400 has begun, 0x080 wins, then 0x200: three frames of 47 bits at 1 Mbit/s.
    assert [time for time, _ in wire.sent] == [141_000]


def fdcan() -> tuple[Core, Wire, Fdcan, list[int]]:
    core = Core()
    wire = Wire(core, 0, 1000)
    ram = [0] * (0x350 // 4)
    can = Fdcan(core, wire, (21, 22), ram)
    return core, wire, can, ram


def test_fdcan_sorts_into_its_fifos_by_its_list() -> None:
    core, wire, can, ram = fdcan()
    ram[0] = 1 << 27 | 0x180 << 16 | 0x1FF  # a range into FIFO 0
    ram[1] = 2 << 30 | 2 << 27 | 0x700 << 16 | 0x780  # a mask into FIFO 1
    ram[2] = 1 << 30 | 3 << 27 | 0x001 << 16 | 0x002  # two that are not wanted
    can.store(0x80, 3 << 16 | 2 << 4)  # three filters; what fits none is not wanted
    can.store(0x54, 1 | 8)
    can.store(0x58, 2)  # FIFO 1 tells on the second line
    can.store(0x5C, 3)
    can.store(0x18, 0)
    wire.bring([Frame(0x181, b"\x01\x02\x03\x04\x05"), Frame(0x705), Frame(0x001), Frame(0x300)])
    core.run(1_000_000)
    assert can.load(0x90) == 1 | 1 << 16
    assert can.load(0x98) == 1 | 1 << 16
    assert ram[0xB0 // 4] == 0x181 << 18
    assert ram[0xB0 // 4 + 1] >> 16 == 5
    assert ram[0xB0 // 4 + 2 : 0xB0 // 4 + 4] == [0x04030201, 0x05]
    assert ram[0x188 // 4 + 1] >> 24 == 1  # the filter
    assert core.lines == {21: True, 22: True}
    can.store(0x94, 0)
    can.store(0x50, 0xFFFFFF)
    assert can.load(0x90) == 0 | 1 << 8 | 1 << 16
    assert core.lines == {21: False, 22: False}


def test_fdcan_sends_in_order_and_says_so() -> None:
    core, wire, can, ram = fdcan()
    can.store(0x54, 1 << 9)
    can.store(0x5C, 1)
    can.store(0x18, 0)
    for number, can_id in enumerate((0x300, 0x100)):
        at = 0x278 // 4 + 18 * number
        assert can.load(0xC4) >> 16 & 3 == number
        ram[at : at + 4] = [can_id << 18, 2 << 16, 0xBEEF, 0]
        can.store(0xCC, 1 << number)
    assert can.load(0xC4) & 7 == 1
    core.run(1_000_000)
    assert [frame for _, frame in wire.sent] == [
        Frame(0x300, b"\xef\xbe"),
        Frame(0x100, b"\xef\xbe"),
    ]
    assert can.load(0xD4) == 3
    assert core.lines[21]


def test_priorities_have_the_bits_of_the_chip_and_a_point() -> None:
    exceptions = Exceptions(4, 8)
    exceptions.set_priority(16, 0x5F)
    exceptions.set_priority(17, 0x40)
    assert exceptions.priorities[16] == 0x50
    exceptions.enabled |= 3 << 16
    exceptions.pending |= 3 << 16
    assert exceptions.find_due(THREAD_PRIORITY) == 17
    exceptions.begin(17)
    assert exceptions.find_due(exceptions.priority) == 0
    exceptions.group_bits = 6  # PRIGROUP 5: only the two highest bits preempt
    assert exceptions.group_of(0x50) == 0x40
    exceptions.end()
    assert exceptions.find_due(THREAD_PRIORITY) == 16
    exceptions.pending |= 1 << PENDSV | 1 << SYSTICK
    assert exceptions.find_due(THREAD_PRIORITY) == PENDSV


def test_an_active_line_comes_again_when_its_exception_is_over() -> None:
    exceptions = Exceptions(4, 8)
    exceptions.enabled |= 1 << 18
    exceptions.hold_line(18, is_active=True)
    exceptions.begin(18)
    assert exceptions.find_due(THREAD_PRIORITY) == 0
    exceptions.end()
    assert exceptions.find_due(THREAD_PRIORITY) == 18
    exceptions.begin(18)
    exceptions.hold_line(18, is_active=False)
    exceptions.end()
    assert exceptions.find_due(THREAD_PRIORITY) == 0


@pytest.mark.parametrize(
    ("family", "writes", "core", "timers"),
    [
        ("F4", {}, 16_000_000, (16_000_000, 16_000_000)),
        # 8 MHz / 8 * 336 / 2, APB1 by 4 and APB2 by 2: their timers at twice that.
        (
            "F4",
            {0x04: 8 | 336 << 6 | 1 << 22, 0x08: 2 | 5 << 10 | 4 << 13},
            168_000_000,
            (84_000_000, 168_000_000),
        ),
        # 8 MHz * 9, APB1 by 2.
        ("F1", {0x04: 2 | 4 << 8 | 1 << 16 | 7 << 18}, 72_000_000, (72_000_000, 72_000_000)),
        # 8 MHz * 6.
        ("F0", {0x04: 2 | 2 << 15 | 4 << 18}, 48_000_000, (48_000_000, 48_000_000)),
        # 16 MHz / 4 * 85 / 2.
        ("G4", {0x0C: 2 | 3 << 4 | 85 << 8, 0x08: 3}, 170_000_000, (170_000_000, 170_000_000)),
        # 16 MHz / 1 * 8 / 2.
        ("G0", {0x0C: 2 | 8 << 8 | 1 << 29, 0x08: 2}, 64_000_000, (64_000_000, 64_000_000)),
        # MSI at 4 MHz, as behind reset; and 4 MHz / 1 * 40 / 2.
        ("L4", {}, 4_000_000, (4_000_000, 4_000_000)),
        ("L4", {0x0C: 1 | 40 << 8, 0x08: 3}, 80_000_000, (80_000_000, 80_000_000)),
    ],
)
def test_the_clock_tree(
    family: str, writes: dict[int, int], core: int, timers: tuple[int, int]
) -> None:
    clocks = Clocks(getattr(trees, family), 8_000_000)
    for offset, value in writes.items():
        clocks.store(offset, value)
    assert (clocks.core(), (clocks.timer(1), clocks.timer(2))) == (core, timers)


def test_ready_bits_follow_their_enables() -> None:
    clocks = Clocks(trees.F4, 8_000_000)
    clocks.store(0x00, clocks.load(0x00) | 1 << 16 | 1 << 24)
    assert clocks.load(0x00) >> 16 & 0x303 == 0x303
    clocks.store(0x00, clocks.load(0x00) & ~(1 << 24))
    assert not clocks.load(0x00) >> 25 & 1
    clocks.store(0x08, 1)
    assert clocks.load(0x08) == 1 | 1 << 2


def test_each_chip_has_its_family_and_no_two_things_at_one_address() -> None:
    assert find_chip("stm32f407vgt6") is CHIPS["STM32F407"]
    assert find_chip("LPC1768") is None
    assert find_chip("STM32F4077") is None
    for family in FAMILIES:
        places = [(family.rcc, 0x400), *((can.address, 0x400) for can in family.can)]
        places += [(timer.address, 0x400) for timer in family.timers]
        places += [(address, 0x400) for address, _ in family.uarts.values()]
        places += family.silent
        places.sort()
        for (first, size), (second, _) in itertools.pairwise(places):
            assert first + size <= second, f"0x{first:08X} and 0x{second:08X}"


def elf(machine: int = 40, kind: int = 2, what: int = 1, size: int = 4, count: int = 1) -> bytes:
    """Return an ELF file of the same segment of four bytes, once or more."""
    head = struct.pack(
        "<4sBBB9xHHIIIIIHHHHHH",
        *(b"\x7fELF", 1, 1, 1, kind, machine, 1, 0x08000000, 52, 0, 0, 52, 32, count, 40, 0, 0),
    )
    at = 52 + 32 * count
    segment = struct.pack("<8I", what, at, 0x08000000, 0x08000000, size, size, 5, 4)
    return head + segment * count + b"abcd" + b"e" * (size if count > 1 else 0)


def with_symbols(data: bytes, names: list[bytes]) -> bytes:
    """Return the file with functions of these names, each two bytes, from 0x08000000 on."""
    text, entries = b"\0", b"\0" * 16
    for place, name in enumerate(names):
        entries += struct.pack("<IIIBBH", len(text), 0x08000001 + 2 * place, 2, 2, 0, 1)
        text += name + b"\0"
    at = len(data)
    sections = struct.pack("<10I", 1, 2, 0, 0, at, len(entries), 1, 0, 4, 16)
    sections += struct.pack("<10I", 2, 3, 0, 0, at + len(entries), len(text), 0, 0, 1, 0)
    end = at + len(entries) + len(text)
    head = data[:32] + struct.pack("<I", end) + data[36:48] + struct.pack("<HH", 2, 0) + data[52:]
    return head + entries + text + sections


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"", "is no ELF file"),
        (elf()[:40], "is a damaged ELF file"),
        (elf(machine=3), "is an ELF file for another core (machine 3, Arm is 40)"),
        (elf(kind=1), "is an ELF file that is not linked to its addresses"),
        (elf(what=3), "is a program for Linux, which the kind program runs"),
        (elf(what=2), "has nothing to be flashed"),
        (elf(size=5), "ends in the middle of what is to be flashed"),
        (elf().replace(b"\x34\0\x20\0", b"\x34\0\x1f\0"), "is a damaged ELF file"),
        (elf(count=2, size=200), "is a damaged ELF file"),  # flashes its bytes twice
    ],
)
def test_a_file_that_is_no_program_for_a_chip(tmp_path: Path, data: bytes, why: str) -> None:
    path = tmp_path / "program.elf"
    path.write_bytes(data)
    right = "give the .elf file that the linker for the chip made"
    with pytest.raises(ConfigError) as raised:
        read_program(path)
    assert str(raised.value) == f"{path}: {why}; {right}"


def test_a_program_of_this_machine_is_none_for_a_chip() -> None:
    with pytest.raises(ConfigError, match="another size of word or order of bytes"):
        read_program(Path(sys.executable))


def test_a_right_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "program.elf"
    path.write_bytes(elf())
    program = read_program(path)
    assert program.segments == ((0x08000000, b"abcd"),)
    assert program.function_at(0x08000000) == "0x08000000"


def test_a_name_is_one_line_of_letters(tmp_path: Path) -> None:
    path = tmp_path / "program.elf"
    path.write_bytes(with_symbols(elf(), [b"main", b"a\nb\x1b[1m", b"x" * 1000]))
    program = read_program(path)
    assert program.names == ("main", "a?b?[1m", "x" * 120)
    assert program.function_at(0x08000003) == "a?b?[1m+0x1"


def test_long_tables_of_symbols_are_read_in_no_time(tmp_path: Path) -> None:
    """In a file of 1.6 MB with a copy of the rest for each name this would be 16 GB."""
    path = tmp_path / "program.elf"
    path.write_bytes(with_symbols(elf(), [b"%060d" % number for number in range(20_000)]))
    assert len(read_program(path).names) == 20_000


def test_what_is_no_file_is_not_waited_for(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for path, why in (
        (pipe, "is no file"),
        (tmp_path, "is no file"),
        (tmp_path / "x", "cannot be"),
    ):
        with pytest.raises(ConfigError, match=why):
            read_program(path)
