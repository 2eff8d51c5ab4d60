"""FDCAN by itself: filters, FIFOs, queue and events, as RM0440, chapter 44, has them."""

import pytest
from support.chip_core import Core

from hil_bench.abilities.controllers.elf.peripherals.fdcan import Fdcan
from hil_bench.abilities.controllers.elf.wire import Wire
from hil_bench.canopen_device.frame import Frame

LONG = Frame(0x12365678, is_extended=True)


def fdcan():
    core = Core()
    wire = Wire(core, 0, 1000)
    ram = [0] * (0x350 // 4)
    can = Fdcan(core, wire, (21, 22), ram)
    return core, wire, can, ram


def test_fdcan_behind_power_on_and_in_initialisation():
    """The reset values of RM0440; CCE falls with INIT, CSR is answered by CSA and INIT."""
    core, wire, can, ram = fdcan()
    reset = {0x00: 0x32141218, 0x04: 0x87654321, 0x0C: 0xA33, 0x18: 1, 0x1C: 0x06000A03}
    reset |= {0x28: 0xFFFF0000, 0x2C: 0xFFFF, 0x44: 0x707, 0x84: 0x1FFFFFFF, 0xC4: 3, 0x50: 0}
    assert {offset: can.load(offset) for offset in reset} == reset
    core.run(70_000_000)
    assert can.load(0x24) == 70_000 & 0xFFFF  # TSCV [us]
    for control, state in ((3, 3), (2, 0), (16, 16 | 8 | 1), (0, 0)):
        can.store(0x18, control)
        assert can.load(0x18) == state
    ram[0x278 // 4 : 0x278 // 4 + 2] = [0x55 << 18, 1 << 23]
    for number in range(3):
        can.store(0xCC, 1)
        wire.bring([Frame(number)])
        core.run(core.time + 1_000_000)
    can.store(0xCC, 1)
    assert (can.load(0xC8), can.load(0xE4)) == (1, 3 | 1 << 24)
    assert can.load(0x90) == 3 | 1 << 24
    can.store(0x18, 1)  # what waited is lost, and what came
    assert [can.load(at) for at in (0xC8, 0xE4, 0x90, 0xC4)] == [0, 0, 0, 3]
    can.store(0xCC, 1)  # asks for nothing while INIT is set
    assert can.load(0xC8) == 0


@pytest.mark.parametrize(("group", "flag"), [(0, 0), (1, 3), (2, 8), (3, 9)])
@pytest.mark.parametrize("others", [False, True])
def test_each_group_of_fdcan_has_its_line(group, flag, *, others):
    """ILS: the FIFOs, 2 transmission (TC, TCF), 3 the list of events with TFE (RM0440).

    Where the others alone are on the second line, it is on the first.
    """
    core, wire, can, _ = fdcan()
    moved, enabled = (0x7F & ~(1 << group), 1) if others else (1 << group, 2)
    for offset, value in ((0x54, 1 << flag), (0x58, moved), (0x5C, enabled), (0x18, 0)):
        can.store(offset, value)
    can.store(0x80, 1 << 4 if group == 1 else 0)
    wire.bring([Frame(1)])
    can.store(0xCC, 7)
    can.store(0xD0, 2)
    core.run(1_000_000)
    assert core.lines == {21: others, 22: not others}
    can.store(0x5C, 3 - enabled)
    assert core.lines == {21: False, 22: False}


@pytest.mark.parametrize(
    "frame", [Frame(0x7FF, b"\x81\x02\x03\x04\x05\x06\x07\x88"), LONG, Frame(5, is_remote=True)]
)
def test_fdcan_sends_a_frame_as_its_buffer_has_it(frame):
    core, wire, can, ram = fdcan()
    can.store(0x18, 0)
    identifier = frame.can_id | 1 << 30 if frame.is_extended else frame.can_id << 18
    low, high = 0x04030281, 0x88070605
    size = len(frame.data) or 1 * frame.is_remote
    words = [identifier | frame.is_remote << 29, size << 16, low, high]
    ram[0x278 // 4 : 0x278 // 4 + 4] = words
    can.store(0xCC, 1)
    core.run(1_000_000)
    assert [sent for _, sent in wire.sent] == [frame]


def test_fdcan_sorts_into_its_fifos_by_its_list():
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


NEAR = LONG._replace(can_id=0x12365600)


@pytest.mark.parametrize(
    ("kind", "action", "first", "second", "found"),
    [
        # RM0440, filter elements. Kinds: a range, two, a mask, off (29 bits: a range without
        # XIDAM). Actions: off, FIFO 0, FIFO 1, rejected, and both FIFOs with priority.
        (0, 1, 0x100, 0x200, {Frame(0x0FF): None, Frame(0x100): 0, Frame(0x200): 0}),
        (0, 1, 0x100, 0x200, {Frame(0x201): None, NEAR: None}),
        (1, 2, 0x100, 0x200, {Frame(0x100): 1, Frame(0x150): None, Frame(0x200): 1}),
        (2, 5, 0x100, 0x700, {Frame(0x1FF): 0, Frame(0x200): None}),
        (2, 6, 0x100, 0x700, {Frame(0x1FF): 1, Frame(0x1FF, is_remote=True): None}),
        (3, 1, 0, 0x7FF, {Frame(0x100): None}),
        (0, 0, 0, 0x7FF, {Frame(0x100): None}),
        (0, 3, 0, 0x7FF, {Frame(0x100): None}),
        # With XIDAM 0x1FFFFF00 0x12365678 counts as 0x12365600.
        (0, 1, NEAR.can_id, NEAR.can_id, {LONG: 0, NEAR: 0, Frame(0x48D): None}),
        (3, 1, NEAR.can_id, NEAR.can_id, {LONG: None, NEAR: 0}),
        (1, 2, 0, NEAR.can_id, {LONG: 1, LONG._replace(is_remote=True): None}),
        (2, 6, 1 << 28, 1 << 28, {LONG: 1, LONG._replace(can_id=5): None}),
        (0, 0, 0, 0x1FFFFFFF, {LONG: None}),
    ],
)
def test_fdcan_filters_of_each_kind_and_action(kind, action, first, second, found):
    """The second of two elements; what fits none, and remote frames, are not wanted."""
    for frame, fifo in found.items():
        core, wire, can, ram = fdcan()
        if frame.is_extended:
            ram[0x78 // 4 : 0x80 // 4] = [action << 29 | first, kind << 30 | second]
        else:
            ram[1] = kind << 30 | action << 27 | first << 16 & 0x7FF0000 | second & 0x7FF
        can.store(0x84, 0x1FFFFF00)
        can.store(0x80, 2 << 24 | 2 << 16 | 3 << 4 | 3 << 2 | 3)
        can.store(0x18, 0)
        wire.bring([frame])
        core.run(1_000_000)
        assert [can.load(at) & 0xF for at in (0x90, 0x98)] == [fifo == 0, fifo == 1]
        if fifo is not None:
            at = (0xB0, 0x188)[fifo] // 4
            identifier = frame.can_id | 1 << 30 if frame.is_extended else frame.can_id << 18
            assert (ram[at], ram[at + 1] >> 24) == (identifier, 1)


@pytest.mark.parametrize("fifo", [0, 1])
def test_fdcan_takes_what_fits_no_filter_where_it_is_to(fifo):
    core, wire, can, ram = fdcan()
    can.store(0x80, fifo << 4 | (1 - fifo) << 2)  # ANFS, ANFE
    can.store(0x18, 0)
    wire.bring([Frame(0x123, is_remote=True), LONG])
    core.run(1_000_000)
    places = [(0xB0, 0x188)[number] // 4 for number in (fifo, 1 - fifo)]
    assert [ram[at] for at in places] == [0x123 << 18 | 1 << 29, LONG.can_id | 1 << 30]
    assert [ram[at + 1] >> 31 for at in places] == [1, 1]  # ANMF


@pytest.mark.parametrize("fifo", [0, 1])
@pytest.mark.parametrize(("overwrites", "kept"), [(False, [1, 2, 3]), (True, [2, 3, 4])])
def test_a_full_fifo_of_fdcan_loses_its_last_or_its_first(fifo, *, overwrites, kept):
    """F0OM and F1OM; RFxN, RFxF and RFxL of IR (RM0440)."""
    core, wire, can, ram = fdcan()
    state, release, at = ((0x90, 0x94, 0xB0), (0x98, 0x9C, 0x188))[fifo]
    can.store(0x80, fifo << 4 | overwrites << 9 - fifo)
    can.store(0x18, 0)
    for number, flags in ((1, 1), (2, 1), (3, 3), (4, 3 if overwrites else 4)):
        wire.bring([Frame(number)])
        core.run(number * 1_000_000)
        assert can.load(0x50) == flags << 3 * fifo
        can.store(0x50, 7 << 3 * fifo)
    got = []
    while can.load(state) & 0xF:
        get = can.load(state) >> 8 & 3
        got.append(ram[at // 4 + 18 * get] >> 18)
        can.store(release, get)
    assert got == kept


def test_fdcan_sends_a_queue_by_identifier_and_takes_back_what_waits():
    core, wire, can, ram = fdcan()
    can.store(0xC0, 1 << 24)  # TFQM
    can.store(0x18, 0)
    for number, can_id in enumerate((0x300, 0x200, 0x100)):
        assert can.load(0xC4) == number << 16
        ram[0x278 // 4 + 18 * number] = can_id << 18
        can.store(0xCC, 1 << number)
    assert can.load(0xC4) == 1 << 21  # full
    assert can.load(0xC8) == 7
    core.run(100_000)  # the first was on the bus at once, the least follows
    assert [frame.can_id for _, frame in wire.sent] == [0x300, 0x100]
    can.store(0xCC, 1 | 4)
    can.store(0xD0, 4)
    assert (can.load(0xC8), can.load(0xD4), can.load(0xD8)) == (3, 0, 4)
    assert can.load(0x50) >> 8 & 1  # TCF
    core.run(1_000_000)
    assert [frame.can_id for _, frame in wire.sent[2:]] == [0x200, 0x300]


def test_fdcan_keeps_events_of_the_frames_that_ask_for_it():
    core, _, can, ram = fdcan()
    can.store(0x18, 0)
    # IR: TFE; TEFN, with the third TEFF, too; a fourth is lost, TEFL. TXEFS: fill, put, full.
    for turn, (flags, state) in enumerate(
        ((3 << 9, 1 | 1 << 16), (3 << 9, 2 | 2 << 16), (7 << 9, 3 | 1 << 24), (9 << 9, 3 | 1 << 24))
    ):
        number = can.load(0xC4) >> 16 & 3
        at = 0x278 // 4 + 18 * number
        ram[at : at + 2] = [0x300 + turn << 18, turn << 24 | 1 << 23]  # MM, EFC
        can.store(0xCC, 1 << number)
        core.run((turn + 1) * 1_000_000)
        assert (can.load(0x50), can.load(0xE4)) == (flags, state)
        can.store(0x50, 0xFFFFFF)
    assert [ram[0x260 // 4 + 2 * at] >> 18 for at in range(3)] == [0x300, 0x301, 0x302]
    assert [ram[0x260 // 4 + 2 * at + 1] >> 24 for at in range(3)] == [0, 1, 2]
    can.store(0xE8, 1)  # the first two are read
    assert can.load(0xE4) == 1 | 2 << 8


def test_fdcan_sends_in_order_and_says_so():
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
    assert (can.load(0xD4), can.load(0xE4)) == (3, 0)  # sent, and no event, as EFC is 0
    assert core.lines[21]
