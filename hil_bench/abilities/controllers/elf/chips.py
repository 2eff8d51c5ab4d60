"""The chips that programs are made for: memory, peripherals, interrupts.

From the reference manuals RM0091 (F0), RM0008 (F1), RM0090 (F4), RM0444 (G0), RM0440 (G4) and
RM0351 (L4), and the data sheets for the sizes of memory.
"""

import re
from collections.abc import Mapping
from typing import Final, NamedTuple

from hil_bench.abilities.controllers.elf.peripherals import clocks

FLASH: Final = 0x0800_0000
MIB: Final = 1 << 20
KIB: Final = 1 << 10


class Memory(NamedTuple):
    """A range of memory.

    Attributes:
        address: of its first byte.
        size: in bytes.
    """

    address: int
    size: int


class Can(NamedTuple):
    """A CAN controller.

    Attributes:
        address: of its registers.
        interrupts: their numbers, in the order of its model.
    """

    address: int
    interrupts: tuple[int, ...]


class Timers(NamedTuple):
    """A timer.

    Attributes:
        address: of its registers.
        interrupt: number of its update interrupt.
        bus: APB 1 or 2, whose clock it has.
        width: of its counter [bit].
    """

    address: int
    interrupt: int
    bus: int = 1
    width: int = 16


class Family(NamedTuple):
    """Chips of one kind.

    Attributes:
        core: of `cpu.MODELS`.
        cpu_id: of CPUID.
        priority_bits: of an interrupt.
        interrupts: how many it has.
        clocks: how its registers set them.
        rcc: address of these.
        can: its CAN controllers, bxCAN or FDCAN.
        message_ram: of FDCAN; 0 for bxCAN.
        uarts: address and interrupt by name.
        is_new_uart: whether they have TDR and ISR.
        timers: all that count.
        silent: ranges that are memory and nothing to speak of: ports, flash and power control.
        initial: words of silent ones behind power on, by address.
        has_bit_band: whether it has the aliases of bits.
        names: of peripherals without a model, by address.
    """

    core: str
    cpu_id: int
    priority_bits: int
    interrupts: int
    clocks: clocks.Tree
    rcc: int
    can: tuple[Can, ...]
    message_ram: int
    uarts: Mapping[str, tuple[int, int]]
    is_new_uart: bool
    timers: tuple[Timers, ...]
    silent: tuple[Memory, ...]
    initial: Mapping[int, int]
    has_bit_band: bool
    names: Mapping[int, str]


class Chip(NamedTuple):
    """A chip.

    Attributes:
        name: as far as it matters here, such as STM32F407.
        family: its kind.
        memory: beside flash.
        flash: its size [byte].
    """

    name: str
    family: Family
    memory: tuple[Memory, ...]
    flash: int = 2 * MIB


_F4_TIMERS = (
    Timers(0x4000_0000, 28, 1, 32),
    Timers(0x4000_0400, 29),
    Timers(0x4000_0800, 30),
    Timers(0x4000_0C00, 50, 1, 32),
    Timers(0x4000_1000, 54),
    Timers(0x4000_1400, 55),
    Timers(0x4000_1800, 43),
    Timers(0x4000_1C00, 44),
    Timers(0x4000_2000, 45),
    Timers(0x4001_0000, 25, 2),
    Timers(0x4001_0400, 44, 2),
    Timers(0x4001_4000, 24, 2),
    Timers(0x4001_4400, 25, 2),
    Timers(0x4001_4800, 26, 2),
)
_L4_TIMERS = (
    Timers(0x4000_0000, 28, 1, 32),
    Timers(0x4000_0400, 29),
    Timers(0x4000_0800, 30),
    Timers(0x4000_0C00, 50, 1, 32),
    Timers(0x4000_1000, 54),
    Timers(0x4000_1400, 55),
    Timers(0x4001_2C00, 25, 2),
    Timers(0x4001_3400, 44, 2),
    Timers(0x4001_4000, 24, 2),
    Timers(0x4001_4400, 25, 2),
    Timers(0x4001_4800, 26, 2),
)
_COMMON_NAMES = {
    0x4000_2800: "RTC",
    0x4000_2C00: "WWDG",
    0x4000_3000: "IWDG",
    0x4000_3800: "SPI2",
    0x4000_3C00: "SPI3",
    0x4000_5400: "I2C1",
    0x4000_5800: "I2C2",
    0x4000_5C00: "I2C3 or USB",
    0x4002_0000: "DMA1",
    0x4002_0400: "DMA2",
    0x4001_3000: "SPI1",
    0x4001_2400: "ADC1",
}
_BX_CAN = (19, 20, 21, 22)

_F0 = Family(
    core="Cortex-M0",
    cpu_id=0x410C_C200,
    priority_bits=2,
    interrupts=32,
    clocks=clocks.F0,
    rcc=0x4002_1000,
    can=(Can(0x4000_6400, (30, 30, 30, 30)),),
    message_ram=0,
    uarts={
        "USART1": (0x4001_3800, 27),
        "USART2": (0x4000_4400, 28),
        "USART3": (0x4000_4800, 29),
        "USART4": (0x4000_4C00, 29),
    },
    is_new_uart=True,
    timers=(
        Timers(0x4000_0000, 15, 1, 32),
        Timers(0x4000_0400, 16),
        Timers(0x4000_1000, 17),
        Timers(0x4000_1400, 18),
        Timers(0x4000_2000, 19),
        Timers(0x4001_2C00, 13),
        Timers(0x4001_4000, 20),
        Timers(0x4001_4400, 21),
        Timers(0x4001_4800, 22),
    ),
    silent=(
        Memory(0x4000_7000, KIB),
        Memory(0x4001_0000, 2 * KIB),
        Memory(0x4002_2000, KIB),
        Memory(0x4800_0000, 8 * KIB),
    ),
    initial={},
    has_bit_band=False,
    names=_COMMON_NAMES,
)
_F1 = Family(
    core="Cortex-M3",
    cpu_id=0x412F_C231,
    priority_bits=4,
    interrupts=68,
    clocks=clocks.F1,
    rcc=0x4002_1000,
    can=(Can(0x4000_6400, _BX_CAN), Can(0x4000_6800, (63, 64, 65, 66))),
    message_ram=0,
    uarts={
        "USART1": (0x4001_3800, 37),
        "USART2": (0x4000_4400, 38),
        "USART3": (0x4000_4800, 39),
    },
    is_new_uart=False,
    timers=(
        Timers(0x4000_0000, 28),
        Timers(0x4000_0400, 29),
        Timers(0x4000_0800, 30),
        Timers(0x4000_0C00, 50),
        Timers(0x4000_1000, 54),
        Timers(0x4000_1400, 55),
        Timers(0x4001_2C00, 25, 2),
    ),
    silent=(
        Memory(0x4000_6C00, 2 * KIB),
        Memory(0x4001_0000, 9 * KIB),
        Memory(0x4002_2000, KIB),
    ),
    initial={},
    has_bit_band=True,
    names=_COMMON_NAMES,
)
_F4 = Family(
    core="Cortex-M4F",
    cpu_id=0x410F_C241,
    priority_bits=4,
    interrupts=96,
    clocks=clocks.F4,
    rcc=0x4002_3800,
    can=(Can(0x4000_6400, _BX_CAN), Can(0x4000_6800, (63, 64, 65, 66))),
    message_ram=0,
    uarts={
        "USART1": (0x4001_1000, 37),
        "USART2": (0x4000_4400, 38),
        "USART3": (0x4000_4800, 39),
        "UART4": (0x4000_4C00, 52),
        "UART5": (0x4000_5000, 53),
        "USART6": (0x4001_1400, 71),
    },
    is_new_uart=False,
    timers=_F4_TIMERS,
    silent=(
        Memory(0x4000_7000, KIB),
        Memory(0x4001_3800, 2 * KIB),
        Memory(0x4002_0000, 12 * KIB),
        Memory(0x4002_3C00, KIB),
    ),
    initial={0x4000_7000: 0xC000, 0x4000_7004: 0x4000},
    has_bit_band=True,
    names={
        **{at: name for at, name in _COMMON_NAMES.items() if at < 0x4002_0000},
        0x4001_2000: "ADC1",
        0x4001_2C00: "SDIO",
        0x4002_3000: "CRC",
        0x4002_6000: "DMA1",
        0x4002_6400: "DMA2",
        0x4000_7400: "DAC",
        0x5000_0000: "USB OTG FS",
    },
)
_G0 = Family(
    core="Cortex-M0",
    cpu_id=0x410C_C601,
    priority_bits=2,
    interrupts=32,
    clocks=clocks.G0,
    rcc=0x4002_1000,
    can=(Can(0x4000_6400, (21, 22)), Can(0x4000_6800, (21, 22))),
    message_ram=0x4000_B400,
    uarts={
        "USART1": (0x4001_3800, 27),
        "USART2": (0x4000_4400, 28),
        "USART3": (0x4000_4800, 29),
        "USART4": (0x4000_4C00, 29),
        "LPUART1": (0x4000_8000, 29),
    },
    is_new_uart=True,
    timers=(
        Timers(0x4000_0000, 15, 1, 32),
        Timers(0x4000_0400, 16),
        Timers(0x4000_0800, 16),
        Timers(0x4000_1000, 17),
        Timers(0x4000_1400, 18),
        Timers(0x4000_2000, 19),
        Timers(0x4001_2C00, 13),
        Timers(0x4001_4000, 20),
        Timers(0x4001_4400, 21),
        Timers(0x4001_4800, 22),
    ),
    silent=(
        Memory(0x4000_7000, KIB),
        Memory(0x4001_0000, KIB),
        Memory(0x4002_1800, KIB),
        Memory(0x4002_2000, KIB),
        Memory(0x5000_0000, 6 * KIB),
    ),
    initial={},
    has_bit_band=False,
    names=_COMMON_NAMES,
)
_G4 = Family(
    core="Cortex-M4F",
    cpu_id=0x410F_C241,
    priority_bits=4,
    interrupts=102,
    clocks=clocks.G4,
    rcc=0x4002_1000,
    can=(
        Can(0x4000_6400, (21, 22)),
        Can(0x4000_6800, (86, 87)),
        Can(0x4000_6C00, (88, 89)),
    ),
    message_ram=0x4000_A400,
    uarts={
        "USART1": (0x4001_3800, 37),
        "USART2": (0x4000_4400, 38),
        "USART3": (0x4000_4800, 39),
        "UART4": (0x4000_4C00, 52),
        "LPUART1": (0x4000_8000, 91),
    },
    is_new_uart=True,
    timers=_L4_TIMERS,
    silent=(
        Memory(0x4000_7000, KIB),
        Memory(0x4001_0000, 2 * KIB),
        Memory(0x4002_2000, KIB),
        Memory(0x4800_0000, 8 * KIB),
    ),
    initial={0x4000_7000: 0x200},
    has_bit_band=True,
    names=_COMMON_NAMES,
)
_L4 = _G4._replace(
    interrupts=82,
    clocks=clocks.L4,
    can=(Can(0x4000_6400, _BX_CAN),),
    message_ram=0,
    uarts={
        "USART1": (0x4001_3800, 37),
        "USART2": (0x4000_4400, 38),
        "USART3": (0x4000_4800, 39),
        "LPUART1": (0x4000_8000, 70),
    },
)
FAMILIES: Final = (_F0, _F1, _F4, _G0, _G4, _L4)
"""All of them."""

_RAM = 0x2000_0000
_CHIPS = (
    Chip("STM32F042", _F0, (Memory(_RAM, 6 * KIB),)),
    Chip("STM32F072", _F0, (Memory(_RAM, 16 * KIB),)),
    Chip("STM32F091", _F0, (Memory(_RAM, 32 * KIB),)),
    Chip("STM32F103", _F1, (Memory(_RAM, 20 * KIB),)),
    Chip("STM32F105", _F1, (Memory(_RAM, 64 * KIB),)),
    Chip("STM32F107", _F1, (Memory(_RAM, 64 * KIB),)),
    Chip("STM32F405", _F4, (Memory(_RAM, 128 * KIB), Memory(0x1000_0000, 64 * KIB))),
    Chip("STM32F407", _F4, (Memory(_RAM, 128 * KIB), Memory(0x1000_0000, 64 * KIB))),
    Chip("STM32F427", _F4, (Memory(_RAM, 192 * KIB), Memory(0x1000_0000, 64 * KIB))),
    Chip("STM32F429", _F4, (Memory(_RAM, 192 * KIB), Memory(0x1000_0000, 64 * KIB))),
    Chip("STM32F446", _F4, (Memory(_RAM, 128 * KIB),)),
    Chip("STM32G0B1", _G0, (Memory(_RAM, 144 * KIB),)),
    Chip("STM32G0C1", _G0, (Memory(_RAM, 144 * KIB),)),
    Chip("STM32G431", _G4, (Memory(_RAM, 32 * KIB), Memory(0x1000_0000, 10 * KIB))),
    Chip("STM32G474", _G4, (Memory(_RAM, 128 * KIB), Memory(0x1000_0000, 32 * KIB))),
    Chip("STM32L476", _L4, (Memory(_RAM, 96 * KIB), Memory(0x1000_0000, 32 * KIB))),
)
CHIPS: Final = {chip.name: chip for chip in _CHIPS}
"""The chips by their names."""


def find_chip(name: str) -> Chip | None:
    """Return the chip of a full or short name, such as STM32F407VGT6; None for one not known."""
    found = re.fullmatch(r"(STM32[A-Z][0-9A-Z]{3})([A-Z][0-9A-Z]*)?", name.upper())
    return CHIPS.get(found[1]) if found else None
