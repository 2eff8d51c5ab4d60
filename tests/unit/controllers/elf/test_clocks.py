"""The clock trees of the families, as their reference manuals have them.

RM0091 (F0), RM0008 (F1), RM0090 (F4), RM0444 (G0), RM0440 (G4), RM0351 (L4).
"""

import pytest

from hil_bench.abilities.controllers.elf.peripherals import clocks as trees
from hil_bench.abilities.controllers.elf.peripherals.clocks import Clocks


def rates(family, writes):
    clocks = Clocks(getattr(trees, family), 8_000_000)
    for offset, value in writes.items():
        clocks.store(offset, value)
    return clocks.core(), (clocks.timer(1), clocks.timer(2))


def test_the_clock_tree():
    rows = [
        ("F4", {}, 16_000_000, (16_000_000, 16_000_000)),
        # 8 MHz / 8 * 336 / 2, APB1 by 4 and APB2 by 2: their timers at twice that.
        (
            "F4",
            {0x04: 8 | 336 << 6 | 1 << 22, 0x08: 2 | 5 << 10 | 4 << 13},
            168_000_000,
            (84_000_000, 168_000_000),
        ),
        ("F4", {0x08: 1}, 8_000_000, (8_000_000, 8_000_000)),
        # 16 MHz / 16 * 200 / 8.
        ("F4", {0x04: 16 | 200 << 6 | 3 << 16, 0x08: 2}, 25_000_000, (25_000_000,) * 2),
        # 8 MHz / 2 * 16, the most; and half of the internal 8 MHz * 2.
        ("F1", {0x04: 2 | 3 << 16 | 15 << 18}, 64_000_000, (64_000_000, 64_000_000)),
        ("F1", {0x04: 2}, 8_000_000, (8_000_000, 8_000_000)),
        ("F1", {0x04: 1 | 8 << 4}, 4_000_000, (4_000_000, 4_000_000)),
        # 8 MHz * 9, APB1 by 2.
        ("F1", {0x04: 2 | 4 << 8 | 1 << 16 | 7 << 18}, 72_000_000, (72_000_000, 72_000_000)),
        # 8 MHz by PREDIV 2, * 12; 8 MHz / 2 * 12; the oscillator of 48 MHz.
        ("F0", {0x2C: 1, 0x04: 2 | 1 << 15 | 10 << 18}, 48_000_000, (48_000_000,) * 2),
        ("F0", {0x04: 2 | 10 << 18}, 48_000_000, (48_000_000,) * 2),
        ("F0", {0x04: 3}, 48_000_000, (48_000_000,) * 2),
        # 8 MHz * 6.
        ("F0", {0x04: 2 | 2 << 15 | 4 << 18}, 48_000_000, (48_000_000, 48_000_000)),
        # 16 MHz / 4 * 85 / 2.
        ("G4", {0x0C: 2 | 3 << 4 | 85 << 8, 0x08: 3}, 170_000_000, (170_000_000, 170_000_000)),
        # Divider 2 of the internal oscillator: 16 MHz / 4; APB by 4; and the crystal, AHB by 512.
        ("G0", {0x00: 0x500 | 2 << 11, 0x08: 5 << 12}, 4_000_000, (2_000_000, 2_000_000)),
        ("G0", {0x08: 1 | 0xF << 8}, 15_625, (15_625, 15_625)),
        # 16 MHz / 1 * 8 / 2.
        ("G0", {0x0C: 2 | 8 << 8 | 1 << 29, 0x08: 2}, 64_000_000, (64_000_000, 64_000_000)),
        # MSI by its range where MSIRGSEL says so: 48 MHz, the last.
        ("L4", {0x00: 8 | 11 << 4}, 48_000_000, (48_000_000, 48_000_000)),
        ("L4", {0x08: 1}, 16_000_000, (16_000_000, 16_000_000)),
        ("G4", {0x08: 2}, 8_000_000, (8_000_000, 8_000_000)),
        # MSI at 4 MHz, as behind reset; and 4 MHz / 1 * 40 / 2.
        ("L4", {}, 4_000_000, (4_000_000, 4_000_000)),
        ("L4", {0x0C: 1 | 40 << 8, 0x08: 3}, 80_000_000, (80_000_000, 80_000_000)),
    ]
    assert [(*row[:2], *rates(*row[:2])) for row in rows] == rows


def test_the_prescalers_divide_as_their_codes_say():
    """HPRE and PPRE of the manuals; the timers have twice the clock of a bus that is divided."""
    by_8 = {8: 2, 9: 4, 10: 8, 11: 16, 12: 64, 13: 128, 14: 256, 15: 512}
    by_4 = {4: 2, 5: 4, 6: 8, 7: 16}
    for name, at, (ahb, first, second) in (
        ("F0", 0x04, (4, 8, 8)),
        ("F1", 0x04, (4, 8, 11)),
        ("F4", 0x08, (4, 10, 13)),
        ("G0", 0x08, (8, 12, 12)),
        ("G4", 0x08, (4, 8, 11)),
        ("L4", 0x08, (4, 8, 11)),
    ):
        clocks = Clocks(getattr(trees, name), 8_000_000)
        switch, whole = clocks.load(at) & 3, clocks.core()
        for code in range(16):
            clocks.store(at, switch | code << ahb)
            assert clocks.core() == whole // by_8.get(code, 1)
        for bus, place in ((1, first), (2, second)):
            for code in range(8):
                clocks.store(at, switch | code << place)
                divider = by_4.get(code, 1)
                assert clocks.timer(bus) == whole // divider * (1 + (divider > 1))


def test_msi_has_the_ranges_of_the_manual():
    clocks = Clocks(trees.L4, 8_000_000)
    kilohertz = []
    for number in range(12):
        clocks.store(0x00, 8 | number << 4)
        kilohertz.append(clocks.core() // 1000)
    # RM0351, RCC_CR.
    assert kilohertz[:6] == [100, 200, 400, 800, 1000, 2000]
    assert kilohertz[6:] == [4000, 8000, 16_000, 24_000, 32_000, 48_000]


@pytest.mark.parametrize(
    ("family", "register", "pairs"),
    [
        # RCC: internal, crystal, PLLs; slow ones, and the one of 48 MHz.
        ("F0", 0x00, ((0, 1), (16, 17), (24, 25))),
        ("F0", 0x34, ((0, 1), (16, 17))),
        ("F1", 0x00, ((0, 1), (16, 17), (24, 25))),
        ("F4", 0x00, ((0, 1), (16, 17), (24, 25), (26, 27), (28, 29))),
        ("G0", 0x00, ((8, 10), (16, 17), (24, 25), (22, 23))),
        ("G4", 0x00, ((8, 10), (16, 17), (24, 25))),
        ("L4", 0x00, ((0, 1), (8, 10), (16, 17), (24, 25), (26, 27), (28, 29))),
        *((name, at, ((0, 1),)) for name in ("F0", "F1") for at in (0x20, 0x24)),
        *(("F4", at, ((0, 1),)) for at in (0x70, 0x74)),
        *(("G0", at, ((0, 1),)) for at in (0x5C, 0x60)),
        *((name, at, ((0, 1),)) for name in ("G4", "L4") for at in (0x90, 0x94, 0x98)),
    ],
)
def test_each_oscillator_has_its_ready_bit(family, register, pairs):
    clocks = Clocks(getattr(trees, family), 8_000_000)
    every = sum(1 << bit for pair in pairs for bit in pair)
    for enable, ready in pairs:
        clocks.store(register, 1 << enable)
        assert clocks.load(register) & every == 1 << enable | 1 << ready


@pytest.mark.parametrize(
    ("family", "reset", "causes", "forget", "hertz"),
    [
        ("F0", {0x00: 0x83, 0x04: 0}, 0x24, 24, 40_000),
        ("F1", {0x00: 0x83, 0x04: 0}, 0x24, 24, 40_000),
        ("F4", {0x00: 0x83, 0x04: 0x24003010, 0x08: 0}, 0x74, 24, 32_000),
        ("G0", {0x00: 0x500, 0x08: 0, 0x0C: 0x1000}, 0x60, 23, 32_000),
        ("G4", {0x00: 0x500, 0x08: 5, 0x0C: 0x1000}, 0x94, 23, 32_000),
        ("L4", {0x00: 0x63, 0x08: 0, 0x0C: 0x1000}, 0x94, 23, 32_000),
    ],
)
def test_a_reset_leaves_its_values_and_its_cause(family, reset, causes, forget, hertz):
    """Reset values, flags of CSR (SFTRSTF 28, IWDGRSTF 29, the pin's 26), RMVF, and LSI."""
    clocks = Clocks(getattr(trees, family), 8_000_000)
    assert {offset: clocks.load(offset) for offset in reset} == reset
    assert clocks.load(causes) >> 25 & 0x7F in {0, 7}  # F4: power, brown-out and the pin
    assert clocks.watchdog_hz == hertz
    for by_watchdog, bits in ((True, 1 << 29 | 1 << 26), (False, 1 << 28 | 1 << 26)):
        clocks.note_reset(by_watchdog=by_watchdog)
        clocks.store(causes, 1)
        assert clocks.load(causes) == bits | 3  # LSION with LSIRDY, and the flags stay
        clocks.store(causes, 1 << forget)
        assert clocks.load(causes) == 1 << forget


def test_ready_bits_follow_their_enables():
    clocks = Clocks(trees.F4, 8_000_000)
    clocks.store(0x00, clocks.load(0x00) | 1 << 16 | 1 << 24)
    assert clocks.load(0x00) >> 16 & 0x303 == 0x303
    clocks.store(0x00, clocks.load(0x00) & ~(1 << 24))
    assert not clocks.load(0x00) >> 25 & 1
    clocks.store(0x08, 1)
    assert clocks.load(0x08) == 1 | 1 << 2
