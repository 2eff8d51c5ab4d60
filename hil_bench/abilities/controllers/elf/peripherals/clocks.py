"""The clock tree of STM32 chips: what the registers of RCC say of the core's and timers' clocks."""

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from hil_bench.abilities.controllers.elf.peripherals.registers import Follow, Followers

_CR, _CFGR = 0x00, 0x04
_AHB = (1, 1, 1, 1, 1, 1, 1, 1, 2, 4, 8, 16, 64, 128, 256, 512)
_APB = (1, 1, 1, 1, 2, 4, 8, 16)
_MSI_KHZ = (100, 200, 400, 800, 1000, 2000, 4000, 8000, 16000, 24000, 32000, 48000)

_CAUSES, _BY_SOFTWARE, _BY_WATCHDOG = 0xFE00_0000, 0x1400_0000, 0x2400_0000  # with the pin's
Registers = Mapping[int, int]


class Tree(NamedTuple):
    """The clocks of a family of chips.

    Attributes:
        follows: ready bits and the switch.
        initial: registers behind power on.
        system: of the registers and the crystal [Hz] gives the system clock [Hz].
        config: offset of the register with the prescalers.
        prescalers: places of HPRE, PPRE1 and PPRE2 in it.
        causes: offset of the register with the causes of a reset.
        forget: the bit there that clears them.
        watchdog_hz: frequency of the watchdog's oscillator [Hz].
    """

    follows: tuple[Follow, ...]
    initial: Mapping[int, int]
    system: Callable[[Registers, int], int]
    config: int
    prescalers: tuple[int, int, int]
    causes: int
    forget: int = 24
    watchdog_hz: int = 32_000


class Clocks(Followers):
    """RCC, with the clocks that it gives.

    Args:
        tree: of the family.
        crystal_hz: frequency of HSE [Hz].

    Attributes:
        followers: are called when a clock may have changed.
    """

    def __init__(self, tree: Tree, crystal_hz: int) -> None:
        self._tree, self._crystal_hz = tree, crystal_hz
        self.followers: list[Callable[[], None]] = []
        super().__init__(tree.follows, tree.initial)

    def store(self, offset: int, value: int) -> None:
        """Keep a value; the clocks may be others then."""
        tree = self._tree
        if offset == tree.causes:
            kept = 0 if value >> tree.forget & 1 else self.values.get(offset, 0) & _CAUSES
            value = value & ~_CAUSES | kept
        super().store(offset, value)
        self._find()

    def reset(self) -> None:
        """Go to the clocks behind power on."""
        super().reset()
        self._find()

    def note_reset(self, *, by_watchdog: bool) -> None:
        """Set the cause of a reset that was no loss of power."""
        causes = self._tree.causes
        self.values[causes] = self.values.get(causes, 0) & ~_CAUSES | (
            _BY_WATCHDOG if by_watchdog else _BY_SOFTWARE
        )

    @property
    def watchdog_hz(self) -> int:
        """The clock of the watchdog [Hz]."""
        return self._tree.watchdog_hz

    def core(self) -> int:
        """Return the core's clock, HCLK [Hz]."""
        return self._core

    def timer(self, bus: int) -> int:
        """Return the clock of the timers on APB 1 or 2 [Hz]: twice that of the bus, if divided."""
        return self._timers[bus]

    def _find(self) -> None:
        tree = self._tree
        config = self.values.get(tree.config, 0)
        ahb, *apb = tree.prescalers
        system = tree.system(self.values, self._crystal_hz)
        self._core = max(system // _AHB[config >> ahb & 0xF], 1)
        dividers = [_APB[config >> place & 7] for place in apb]
        self._timers = (0, *(max(self._core // each * (1 + (each > 1)), 1) for each in dividers))
        for follow in self.followers:
            follow()


def _f4(values: Registers, crystal: int) -> int:
    source = values.get(0x08, 0) >> 2 & 3
    if source == 0:
        return 16_000_000
    if source == 1:
        return crystal
    pll = values.get(0x04, 0)
    base = crystal if pll >> 22 & 1 else 16_000_000
    return base * (pll >> 6 & 0x1FF) // max(pll & 0x3F, 1) // (2 * (pll >> 16 & 3) + 2)


def _f1(values: Registers, crystal: int) -> int:
    config = values.get(_CFGR, 0)
    source = config >> 2 & 3
    if source < 2:
        return (8_000_000, crystal)[source]
    base = crystal // (1 + (config >> 17 & 1)) if config >> 16 & 1 else 4_000_000
    return base * min((config >> 18 & 0xF) + 2, 16)


def _f0(values: Registers, crystal: int) -> int:
    config = values.get(_CFGR, 0)
    source = config >> 2 & 3
    if source != 2:
        return (8_000_000, crystal, 0, 48_000_000)[source]
    divider = (values.get(0x2C, 0) & 0xF) + 1
    base = (4_000_000, 8_000_000 // divider, crystal // divider, 48_000_000 // divider)
    return base[config >> 15 & 3] * min((config >> 18 & 0xF) + 2, 16)


def _pll(values: Registers, sources: tuple[int, ...], first: int) -> int:
    """Return the output R of the PLL of G0, G4 and L4 [Hz]."""
    pll = values.get(0x0C, 0)
    divided = sources[pll & 3] // ((pll >> 4 & 0xF if first == 4 else pll >> 4 & 7) + 1)
    counted = divided * (pll >> 8 & 0x7F)
    return counted // ((pll >> 29 & 7) + 1) if first == 0 else counted // (2 * (pll >> 25 & 3) + 2)


def _g4(values: Registers, crystal: int) -> int:
    source = values.get(0x08, 0) >> 2 & 3
    if source < 3:
        return (16_000_000, 16_000_000, crystal)[source]
    return _pll(values, (0, 0, 16_000_000, crystal), 4)


def _l4(values: Registers, crystal: int) -> int:
    control = values.get(_CR, 0)
    number = control >> 4 & 0xF if control & 8 else 6
    msi = _MSI_KHZ[min(number, len(_MSI_KHZ) - 1)] * 1000
    source = values.get(0x08, 0) >> 2 & 3
    if source < 3:
        return (msi, 16_000_000, crystal)[source]
    return _pll(values, (0, msi, 16_000_000, crystal), 3)


def _g0(values: Registers, crystal: int) -> int:
    source = values.get(0x08, 0) >> 3 & 7
    if source == 0:
        return 16_000_000 >> (values.get(_CR, 0) >> 11 & 7)
    if source == 1:
        return crystal
    if source == 2:
        return _pll(values, (0, 0, 16_000_000, crystal), 0)
    return 32_000


def _ready(register: int, *pairs: tuple[int, int]) -> tuple[Follow, ...]:
    """Return ready bits by the bits that enable, both in one register."""
    return tuple(Follow(register, 1, enable, register, ready) for enable, ready in pairs)


_OLD = (
    *_ready(_CR, (0, 1), (16, 17), (24, 25)),
    Follow(_CFGR, 3, 0, _CFGR, 2),
    *_ready(0x20, (0, 1)),
    *_ready(0x24, (0, 1)),
)
_NEW = (
    Follow(0x08, 3, 0, 0x08, 2),
    *_ready(0x90, (0, 1)),
    *_ready(0x94, (0, 1)),
    *_ready(0x98, (0, 1)),
)
# RM0091, RM0008, RM0090, RM0444, RM0440, RM0351.
F1: Final = Tree(_OLD, {_CR: 0x83}, _f1, _CFGR, (4, 8, 11), 0x24, watchdog_hz=40_000)
F0: Final = F1._replace(
    follows=(*_OLD, *_ready(0x34, (0, 1), (16, 17))), system=_f0, prescalers=(4, 8, 8)
)
F4: Final = Tree(
    (
        *_ready(_CR, (0, 1), (16, 17), (24, 25), (26, 27), (28, 29)),
        Follow(0x08, 3, 0, 0x08, 2),
        *_ready(0x70, (0, 1)),
        *_ready(0x74, (0, 1)),
    ),
    {_CR: 0x83, 0x04: 0x2400_3010, 0x74: 0x0E00_0000},
    _f4,
    0x08,
    (4, 10, 13),
    0x74,
)
G0: Final = Tree(
    (
        *_ready(_CR, (8, 10), (16, 17), (24, 25), (22, 23)),
        Follow(0x08, 7, 0, 0x08, 3),
        *_ready(0x5C, (0, 1)),
        *_ready(0x60, (0, 1)),
    ),
    {_CR: 0x500, 0x0C: 0x1000},
    _g0,
    0x08,
    (8, 12, 12),
    0x60,
    23,
)
G4: Final = Tree(
    (*_ready(_CR, (8, 10), (16, 17), (24, 25)), *_NEW),
    {_CR: 0x500, 0x08: 0x5, 0x0C: 0x1000},
    _g4,
    0x08,
    (4, 8, 11),
    0x94,
    23,
)
L4: Final = G4._replace(
    follows=(*_ready(_CR, (0, 1), (8, 10), (16, 17), (24, 25), (26, 27), (28, 29)), *_NEW),
    initial={_CR: 0x63, 0x0C: 0x1000},
    system=_l4,
)
