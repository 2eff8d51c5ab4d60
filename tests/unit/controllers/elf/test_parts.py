"""Parts of a chip by themselves: filters, FIFOs, arbitration, priorities, files.

Expected values follow from the reference manual RM0090 (bxCAN) and the Armv7-M Architecture
Reference Manual (priorities).
"""

import itertools
import os
import random
import struct
import sys
from pathlib import Path

import pytest
from support.chip_core import Core

from hil_bench.abilities.controllers.elf.calls import find_calls
from hil_bench.abilities.controllers.elf.cells import COUNTED, KEPT
from hil_bench.abilities.controllers.elf.chips import CHIPS, FAMILIES, find_chip
from hil_bench.abilities.controllers.elf.core_view import (
    HARD_FAULT,
    NMI,
    PENDSV,
    SYSTICK,
    THREAD_PRIORITY,
)
from hil_bench.abilities.controllers.elf.elf_file import read_program
from hil_bench.abilities.controllers.elf.peripherals.bxcan import BxCan, Filters
from hil_bench.abilities.controllers.elf.peripherals.timer import Timer
from hil_bench.abilities.controllers.elf.wire import Wire, rank
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import ConfigError

BX_CAN, BX_CAN_2 = [19, 20, 21, 22], [63, 64, 65, 66]


def test_a_wide_mask_and_a_list_of_narrow_ones():
    filters = Filters(are_shared=False)
    filters.store(0x20C, 0b01)  # bank 0 wide
    filters.store(0x204, 0b10)  # bank 1 a list, narrow
    filters.store(0x214, 0b10)  # bank 1 into FIFO 1
    filters.store(0x240, 0x180 << 21)
    filters.store(0x244, 0x780 << 21)
    filters.store(0x248, 0x701 << 5 | (0x702 << 5) << 16)
    filters.store(0x24C, 0x703 << 5 | (0x704 << 5) << 16)
    filters.store(0x21C, 0b11)
    filters.store(0x200, 0xE00)
    assert filters.match(Frame(0x181)) == (0, 0)
    assert filters.match(Frame(0x703)) == (1, 2)
    assert filters.match(Frame(0x705)) is None
    assert filters.match(Frame(0x701, is_remote=True)) is None
    assert filters.match(Frame(0x181), is_second=True) is None  # of a chip with one controller


def test_the_second_controller_has_the_banks_from_can2sb_on():
    filters = Filters(are_shared=True)
    filters.store(0x20C, 0b11)  # two wide masks
    filters.store(0x240, 0x180 << 21)
    filters.store(0x244, 0x780 << 21)
    filters.store(0x248, 0x200 << 21)
    filters.store(0x24C, 0x780 << 21)
    filters.store(0x21C, 0b11)
    found = []
    for start in (1, 2):
        filters.store(0x200, start << 8)
        frames = Frame(0x181), Frame(0x201)
        found.append([filters.match(f, is_second=s) for f in frames for s in (False, True)])
    assert found == [[(0, 0), None, None, (0, 0)], [(0, 0), None, (0, 1), None]]


LONG = Frame(0x12365678, is_extended=True)  # its first 11 bits are 0x48D, the next three 4


@pytest.mark.parametrize(
    ("is_wide", "is_list", "first", "second", "wanted", "unwanted"),
    [
        # RM0090, filter bank scale: STID from bit 21, EXID from bit 3, IDE 4, RTR 2; in half a
        # word STID from bit 5, RTR 16, IDE 8, and the next three bits of an extended identifier.
        (
            True,
            True,
            0x123 << 21,
            0x12365678 << 3 | 4,
            {Frame(0x123): 0, LONG: 1},
            (Frame(0x123, is_remote=True), Frame(0x124), LONG._replace(is_remote=True)),
        ),
        (
            True,
            False,
            0x12365678 << 3 | 4,
            0x1FFFFF00 << 3 | 4,
            {LONG: 0, LONG._replace(can_id=0x123656FF, is_remote=True): 0},
            (LONG._replace(can_id=0x12365778), Frame(0x48D)),
        ),
        (
            False,
            True,
            0x123 << 5 | (0x123 << 5 | 16) << 16,
            0x48D << 5 | 8 | 4 | (0x48D << 5) << 16,
            {Frame(0x123): 0, Frame(0x123, is_remote=True): 1, LONG: 2, Frame(0x48D): 3},
            (LONG._replace(can_id=0x1236D678), LONG._replace(is_remote=True), Frame(0x124)),
        ),
        (
            False,
            False,
            0x120 << 5 | (0x7F0 << 5 | 16) << 16,
            0x48D << 5 | 8 | (0x7FF << 5 | 8) << 16,
            {Frame(0x12F): 0, LONG: 1, LONG._replace(can_id=0x1236D678, is_remote=True): 1},
            (Frame(0x130), Frame(0x12F, is_remote=True), Frame(0x48D)),
        ),
    ],
)
def test_a_bank_of_each_width_and_kind(*, is_wide, is_list, first, second, wanted, unwanted):
    filters = Filters(are_shared=False)
    for offset, value in (
        (0x204, is_list << 9),
        (0x20C, is_wide << 9),
        (0x21C, 1 << 9),
        (0x240 + 8 * 9, first),
        (0x244 + 8 * 9, second),
    ):
        filters.store(offset, value)
        assert filters.load(offset) == value
    assert not any(filters.match(frame) for frame in wanted)  # FINIT, as behind reset
    filters.store(0x200, 0xE00)
    # The nine banks before it are narrow masks, of two filters each.
    assert {frame: filters.match(frame) for frame in wanted} == {
        frame: (0, 18 + place) for frame, place in wanted.items()
    }
    assert not any(filters.match(frame) for frame in unwanted)


def test_of_two_filters_the_wider_and_then_the_list_wins():
    filters = Filters(are_shared=False)
    filters.store(0x20C, 0b110)  # banks 1 and 2 wide
    filters.store(0x204, 0b100)  # bank 2 a list
    filters.store(0x21C, 0b111)
    for offset in (0x240, 0x244, 0x248, 0x24C):
        filters.store(offset, 0)  # masks that let all in
    filters.store(0x250, 0x123 << 21)
    filters.store(0x200, 0xE00)
    # Bank 0 has the numbers 0 and 1, bank 1 the number 2, bank 2 the numbers 3 and 4.
    assert filters.match(Frame(0x123)) == (0, 3)
    assert filters.match(Frame(0x124)) == (0, 2)


def bxcan(bit_ns):
    core = Core()
    wire = Wire(core, 0, bit_ns)
    can = BxCan(core, wire, (19, 20, 21, 22), Filters(are_shared=False))
    for offset, value in ((0x20C, 1), (0x21C, 1), (0x200, 0x2A1C0E00), (0x14, 0x13), (0x00, 0)):
        can.store(offset, value)
    return core, wire, can


def test_bxcan_behind_power_on_and_in_initialisation():
    """The reset values of RM0090; MSR answers INRQ and SLEEP, BTR needs INAK."""
    core = Core()
    can = BxCan(core, Wire(core, 0, 1000), (19, 20, 21, 22), Filters(are_shared=False))
    reset = {0x00: 0x10002, 0x04: 0xC02, 0x08: 0x1C000000, 0x14: 0, 0x18: 0, 0x1C: 0x01230000}
    reset |= {0x0C: 0, 0x10: 0, 0x200: 0x2A1C0E01}
    assert {offset: can.load(offset) for offset in reset} == reset
    for control, state in ((1, 0xC01), (0, 0xC00), (2, 0xC02)):
        can.store(0x00, control)
        can.store(0x1C, 0x230000 | control)
        assert (can.load(0x00), can.load(0x04), can.load(0x1C)) == (control, state, 0x230001)
        can.store(0x14, control)
        assert can.load(0x14) == control
    can.store(0x00, 0x8000)  # RESET
    assert {offset: can.load(offset) for offset in reset} == reset


@pytest.mark.parametrize(
    "frame",
    [
        Frame(0x7FF, b"\x81\x02\x03\x04\x05\x06\x07\x88"),
        LONG._replace(data=b"\x01"),
        Frame(5, is_remote=True),
    ],
)
def test_a_frame_looped_back_comes_as_it_was_sent(frame):
    """LBKM: no bus, but the registers of mailbox 2 and of FIFO 0, as RM0090 has them."""
    core, wire, can = bxcan(1000)
    for offset, value in ((0x00, 1), (0x1C, 1 << 30), (0x00, 0)):
        can.store(offset, value)
    identifier = frame.can_id << 3 | 4 if frame.is_extended else frame.can_id << 21
    identifier |= 2 * frame.is_remote
    words = [int.from_bytes(frame.data[at : at + 4], "little") for at in (0, 4)]
    for offset, value in ((0x1A4, len(frame.data)), (0x1A8, words[0]), (0x1AC, words[1])):
        can.store(offset, value)
    can.store(0x1A0, identifier | 1)
    core.run(46_000)
    assert can.load(0x1A0) == identifier | 1  # TXRQ, until it is sent
    core.run(1_000_000)
    assert can.load(0x1A0) == identifier
    received = [can.load(at) for at in range(0x1B0, 0x1C0, 4)]
    assert received == [identifier, len(frame.data), *words]
    assert wire.sent == []


@pytest.mark.parametrize(("control", "kept"), [(0, [1, 2, 4]), (8, [1, 2, 3])])
def test_a_full_fifo_loses_a_frame_on_copper(control, kept):
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


@pytest.mark.parametrize(("enable", "frames"), [(2, 1), (4, 3), (8, 4)])
@pytest.mark.parametrize("fifo", [0, 1])
def test_a_fifo_interrupts_for_a_frame_a_full_fifo_and_an_overrun(enable, frames, fifo):
    """FMPIE, FFIE and FOVIE of each FIFO by itself (RM0090, CAN_IER)."""
    core, wire, can = bxcan(1000)
    can.store(0x214, fifo)
    can.store(0x14, enable << 3 * fifo)
    for number in range(1, 5):
        wire.bring([Frame(number)])
        core.run(number * 1_000_000)
        assert core.lines[20 + fifo] is (number >= frames)
    can.store(0x0C + 4 * fifo, 16 | 32)  # FOVR and RFOM: two are left
    assert core.lines[20 + fifo] is (enable == 2)
    assert not core.lines[21 - fifo]


@pytest.mark.parametrize("number", [1, 2])
def test_a_waiting_frame_can_be_taken_back(number):
    """ABRQ of its mailbox: RQCP without TXOK, and the mailbox is empty (RM0090, CAN_TSR)."""
    core, wire, can = bxcan(1000)
    for mailbox in range(3):
        at = 0x180 + 16 * mailbox
        can.store(at + 4, 0)
        can.store(at, 0x100 + mailbox << 21 | 1)
    can.store(0x08, 1 << 8 * number)  # RQCP alone takes nothing back
    assert can.load(0x08) == 0
    can.store(0x08, 0x80 << 8 * number)
    assert can.load(0x08) >> 8 * number & 3 == 1
    assert can.load(0x08) >> 26 == 1 << number
    core.run(1_000_000)
    sent = [frame.can_id for _, frame in wire.sent]
    assert sent == [0x100 + mailbox for mailbox in range(3) if mailbox != number]


def test_a_full_fifo_holds_frames_back_on_a_bus_without_time():
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


def test_frames_of_a_bus_without_time_come_as_the_shortest_do_on_a_wire():
    core, wire, _ = bxcan(0)
    times = []
    wire.receive = lambda _: bool(times.append(core.time) or True)
    wire.bring([Frame(1), Frame(2), Frame(3)])
    core.run(1_000_000)
    assert times == [0, 50_000, 100_000]  # 47 bits at 1 Mbit/s, rounded up


def test_a_timer_counts_to_its_compare_and_its_end():
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


def test_a_timer_of_one_pulse_stands_before_it_and_behind_it():
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


def test_a_timer_loses_no_time_while_its_compare_is_written():
    core = Core()
    timer = Timer(core, 28, lambda: 8_000_000, width=32)
    for offset, value in ((0x28, 7), (0x14, 1), (0, 1)):
        timer.store(offset, value)
    for _ in range(1000):
        core.run(core.time + 700)
        timer.store(0x34, timer.load(0x24) + 100)
    # 8 MHz / 8 counts microseconds: 1000 times 0.7 us.
    assert timer.load(0x24) == 700


def test_the_count_that_a_core_reads_by_itself_is_that_of_the_timer():
    """Whatever a program does to it: start and stop, UG with and without UDIS, ARR, OPM, clocks."""
    core, draw = Core(), random.Random(29)  # noqa: S311 - the same at each run is meant
    clock = [8_000_000]
    timer = Timer(core, 28, lambda: clock[0])
    cells, seen = timer.cells, set()
    assert cells is not None
    assert cells.kinds[0x24 // 4] == COUNTED
    for _ in range(2000):
        core.run(core.time + draw.randrange(30_000))
        offset = draw.choice((0x00, 0x00, 0x14, 0x24, 0x28, 0x2C, 0x34))
        most = {0x14: 1, 0x28: 9}.get(offset, 99)
        value = draw.choice((0, 1, 1, 3, 9)) if offset == 0 else draw.randrange(most) + 1
        timer.store(offset, value)
        if draw.random() < 0.1:
            clock[0] = draw.choice((8_000_000, 84_000_000))
            timer.follow()
        begin, counts, nanoseconds, most = cells.ramp
        count = cells.words[0x24 // 4]
        if nanoseconds:
            count = max(min((core.time - begin) * counts // nanoseconds, most), 0)
        assert count == timer.load(0x24)
        assert cells.words[0x10 // 4] == timer.load(0x10)
        seen.add((count > 0, nanoseconds > 0))
    assert len(seen) == 4


def test_a_compare_comes_into_reach_with_the_end_of_the_count():
    """ARR from 99 to 299 and back in the same turn: 150 lies ahead, then behind the end."""
    for until, flags in ((160_000, 2), (30_000, 0)):
        core = Core()
        timer = Timer(core, 28, lambda: 8_000_000)
        for offset, value in ((0x28, 7), (0x2C, 99), (0x34, 150), (0x14, 1), (0x10, 0), (0, 1)):
            timer.store(offset, value)
        core.run(20_000)
        timer.store(0x2C, 299)
        core.run(until)
        timer.store(0x2C, 99)
        core.run(until + 1)
        assert timer.load(0x10) & 2 == flags


def test_a_write_of_what_a_compare_is_changes_nothing():
    """So a core that leaves it out finds the same flags at the same times."""
    draw, cores = random.Random(8), (Core(), Core())  # noqa: S311 - the same at each run is meant
    timers = [Timer(core, 28, lambda: 8_000_000) for core in cores]
    left_out = raised = 0
    for _ in range(3000):
        pause = draw.randrange(30_000)
        offset = draw.choice((0x00, 0x10, 0x14, 0x24, 0x28, 0x2C, 0x34, 0x34, 0x34))
        value = draw.choice((20, 40, 80))
        if offset in {0x00, 0x14}:
            value = 1
        for core in cores:
            core.run(core.time + pause)
        assert timers[0].load(0x10) == timers[1].load(0x10)
        raised += timers[0].load(0x10) & 2
        timers[0].store(offset, value)
        cells = timers[1].cells
        assert cells is not None
        if cells.kinds[offset // 4] & KEPT and cells.words[offset // 4] == value:
            left_out += 1
        else:
            timers[1].store(offset, value)
    assert left_out > 100
    assert raised > 100


def test_the_least_identifier_goes_first_unless_in_order_of_request():
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


def test_the_lesser_identifier_wins_the_bus():
    core, wire, can = bxcan(1000)
    wire.bring([Frame(0x400), Frame(0x080)])
    can.store(0x180, 0x200 << 21 | 1)
    core.run(1_000_000)
    # 0x400 has begun, 0x080 wins, then 0x200: three frames of 47 bits at 1 Mbit/s.
    assert [time for time, _ in wire.sent] == [141_000]


def test_frames_come_later_by_what_is_drawn():
    """On a bus that takes no time: 20 us, then 50 us behind it and 30 us; then 40 us anew."""
    core, came = Core(), []
    delays = iter((20_000, 30_000, 40_000))
    wire = Wire(core, 0, 0, delay=lambda: next(delays))
    wire.receive = lambda frame: not came.append((core.now(), frame.can_id))
    wire.bring([Frame(1), Frame(2)])
    core.run(1_000_000)
    wire.bring([Frame(3)])
    core.run(2_000_000)
    assert came == [(20_000, 1), (100_000, 2), (1_040_000, 3)]


def test_extended_frames_take_longer_and_lose_to_base_frames():
    """ISO 11898-1: 20 bits more; of the same first 11 bits the base frame wins."""
    wire = Wire(Core(), 0, 1000)
    frames = (Frame(1), Frame(1, bytes(8)), LONG, LONG._replace(data=b"\0"))
    assert [wire.duration(each) for each in frames] == [47_000, 111_000, 67_000, 75_000]
    order = [
        Frame(0x48C),
        Frame(0x48D),
        LONG._replace(can_id=LONG.can_id - 1),
        LONG,
        LONG._replace(can_id=LONG.can_id + 1),
        Frame(0x48E),
        LONG._replace(can_id=LONG.can_id + (1 << 18)),
        Frame(0x48F),
    ]
    assert sorted([*order[4:], *order[:4]], key=rank) == order


def test_reset_nmi_and_hard_fault_have_fixed_priorities():
    """-3 to -1, above all that can be set (Armv7-M ARM, table B1-4)."""
    exceptions = find_calls().Exceptions(4, 8)
    for number in (NMI, HARD_FAULT):
        exceptions.set_priority(number, 0x40)
    assert exceptions.priorities[1:5] == [-3, -2, -1, 0]
    assert exceptions.count == 24
    exceptions.set_priority(24, 0x40)  # the chip has interrupts 0 to 7
    assert len(exceptions.priorities) == 24
    exceptions.enabled |= 1 << 16
    exceptions.pending = 1 << NMI | 1 << HARD_FAULT | 1 << 16
    for number, priority in ((16, 0), (HARD_FAULT, -1), (NMI, -2)):
        if number != 16:
            assert exceptions.find_due(exceptions.priority) == NMI
        exceptions.begin(number)
        assert exceptions.priority == priority
    assert exceptions.find_due(exceptions.priority) == 0
    exceptions.reset()
    assert (exceptions.pending, exceptions.active, exceptions.enabled >> 16) == (0, [], 0)
    assert exceptions.priority == THREAD_PRIORITY == 256


def test_priorities_have_the_bits_of_the_chip_and_a_point():
    exceptions = find_calls().Exceptions(4, 8)
    exceptions.set_priority(16, 0x5F)
    exceptions.set_priority(17, 0x40)
    assert exceptions.priorities[16] == 0x50
    exceptions.enabled |= 3 << 16
    exceptions.pending |= 3 << 16
    assert exceptions.find_due(THREAD_PRIORITY) == 17
    exceptions.begin(17)
    assert exceptions.find_due(exceptions.priority) == 0
    exceptions.group_bits = 6  # PRIGROUP 5: only the two highest bits preempt
    exceptions.end()
    assert exceptions.find_due(THREAD_PRIORITY) == 16
    exceptions.begin(16)
    assert exceptions.priority == 0x40
    exceptions.end()
    exceptions.pending |= 1 << PENDSV | 1 << SYSTICK
    assert exceptions.find_due(THREAD_PRIORITY) == PENDSV


def test_an_active_line_comes_again_when_its_exception_is_over():
    exceptions = find_calls().Exceptions(4, 8)
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


def test_each_chip_has_its_family_and_no_two_things_at_one_address():
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
        # Each has a range of 1 KiB of its own (the memory maps of the reference manuals).
        assert not any(place % 0x400 for place in (*dict(places), *family.names))


@pytest.mark.parametrize(
    ("chip", "can", "uarts", "timers"),
    [
        # The vector tables of the reference manuals: RM0091, RM0008, RM0090, RM0444, RM0440,
        # RM0351. CAN1 and its like; USART1 and on; the timers by address, TIM2 first.
        ("STM32F072", [30], [27, 28, 29, 29], [15, 16, 17, 18, 19, 13, 20, 21, 22]),
        ("STM32F105", [*BX_CAN, *BX_CAN_2], [37, 38, 39], [28, 29, 30, 50, 54, 55, 25]),
        (
            "STM32F407",
            [*BX_CAN, *BX_CAN_2],
            [37, 38, 39, 52, 53, 71],
            [28, 29, 30, 50, 54, 55, 43, 44, 45, 25, 44, 24, 25, 26],
        ),
        ("STM32G0B1", [21, 22], [27, 28, 29, 29, 29], [15, 16, 16, 17, 18, 19, 13, 20, 21, 22]),
        (
            "STM32G474",
            [21, 22, 86, 87, 88, 89],
            [37, 38, 39, 52, 91],
            [28, 29, 30, 50, 54, 55, 25, 44, 24, 25, 26],
        ),
        ("STM32L476", BX_CAN, [37, 38, 39, 70], [28, 29, 30, 50, 54, 55, 25, 44, 24, 25, 26]),
    ],
)
def test_each_peripheral_has_the_interrupt_of_the_manual(chip, can, uarts, timers):
    family = CHIPS[chip].family
    assert sorted({number for each in family.can for number in each.interrupts}) == can
    assert [interrupt for _, interrupt in family.uarts.values()] == uarts
    assert [timer.interrupt for timer in family.timers] == timers
    # TIM2, and TIM5 where it is, count 32 bits, but for those of F1; APB2 begins at 0x40010000.
    wide = {0x4000_0000, 0x4000_0C00} if chip != "STM32F105" else set()
    assert {timer.address for timer in family.timers if timer.width == 32} == wide & {
        timer.address for timer in family.timers
    }
    if chip[5:7] not in {"F0", "G0"}:  # which have one bus
        assert all(timer.bus == 1 + (timer.address >= 0x4001_0000) for timer in family.timers)


def test_each_chip_has_the_memory_of_its_data_sheet():
    """RAM, and beside it what is coupled to the core, of the largest with each name [KiB]."""
    sizes = {name: [memory.size / 1024 for memory in chip.memory] for name, chip in CHIPS.items()}
    assert sizes == {
        "STM32F042": [6],
        "STM32F072": [16],
        "STM32F091": [32],
        "STM32F103": [20],
        "STM32F105": [64],
        "STM32F107": [64],
        "STM32F405": [128, 64],
        "STM32F407": [128, 64],
        "STM32F427": [192, 64],
        "STM32F429": [192, 64],
        "STM32F446": [128],
        "STM32G0B1": [144],
        "STM32G0C1": [144],
        "STM32G431": [32, 10],  # the second is seen at the end of the first, too
        "STM32G474": [128, 32],
        "STM32L476": [96, 32],
    }
    for chip in CHIPS.values():
        assert [memory.address for memory in chip.memory] == [0x2000_0000, 0x1000_0000][
            : len(chip.memory)
        ]


def elf(machine=40, kind=2, what=1, size=4, count=1):
    """Return an ELF file of the same segment of four bytes, once or more."""
    head = struct.pack(
        "<4sBBB9xHHIIIIIHHHHHH",
        *(b"\x7fELF", 1, 1, 1, kind, machine, 1, 0x08000000, 52, 0, 0, 52, 32, count, 40, 0, 0),
    )
    at = 52 + 32 * count
    segment = struct.pack("<8I", what, at, 0x08000000, 0x08000000, size, size, 5, 4)
    return head + segment * count + b"abcd" + b"e" * (size if count > 1 else 0)


def with_symbols(data, names):
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
def test_a_file_that_is_no_program_for_a_chip(make_file, data, why):
    path = make_file("program.elf", data)
    right = "give the .elf file that the linker for the chip made"
    with pytest.raises(ConfigError) as raised:
        read_program(path)
    assert str(raised.value) == f"{path}: {why}; {right}"


def test_a_program_of_this_machine_is_none_for_a_chip():
    with pytest.raises(ConfigError, match="another size of word or order of bytes"):
        read_program(Path(sys.executable))


def test_a_right_file_is_read(make_file):
    path = make_file("program.elf", elf())
    program = read_program(path)
    assert program.segments == ((0x08000000, b"abcd"),)
    assert program.function_at(0x08000000) == "0x08000000"


def test_a_name_is_one_line_of_letters(make_file):
    path = make_file("program.elf", with_symbols(elf(), [b"main", b"a\nb\x1b[1m", b"x" * 1000]))
    program = read_program(path)
    assert program.names == ("main", "a?b?[1m", "x" * 120)
    assert program.function_at(0x08000003) == "a?b?[1m+0x1"


def test_long_tables_of_symbols_are_read_in_no_time(tmp_path):
    """In a file of 1.6 MB with a copy of the rest for each name this would be 16 GB."""
    path = tmp_path / "program.elf"
    path.write_bytes(with_symbols(elf(), [b"%060d" % number for number in range(20_000)]))
    assert len(read_program(path).names) == 20_000


def test_what_is_no_file_is_not_waited_for(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for path, why in (
        (pipe, "is no file"),
        (tmp_path, "is no file"),
        (tmp_path / "x", "cannot be"),
    ):
        with pytest.raises(ConfigError, match=why):
            read_program(path)
