"""USARTs of STM32, outwards: what a program prints; nothing ever comes in."""

from collections.abc import Callable
from typing import NamedTuple

from hil_bench.abilities.controllers.elf.core_view import Core
from hil_bench.abilities.controllers.elf.peripherals.registers import Peripheral

_TXE, _TC = 0x80, 0x40


class Layout(NamedTuple):
    """The places of the registers that matter.

    Attributes:
        control: of CR1.
        status: of SR or ISR.
        data: of DR or TDR.
        ready: bits of status that say that it is ready.
    """

    control: int
    status: int
    data: int
    ready: int


OLD = Layout(0x0C, 0x00, 0x04, _TXE | _TC)
"""Of F1 and F4."""

NEW = Layout(0x00, 0x1C, 0x28, _TXE | _TC | 1 << 21 | 1 << 22)
"""Of F0, G0, G4 and L4."""


class Uart(Peripheral):
    """A USART that is always ready to send.

    Args:
        core: of the chip.
        interrupt: its number.
        layout: of its registers.
        printed: takes each byte.
    """

    def __init__(
        self, core: Core, interrupt: int, layout: Layout, printed: Callable[[int], None]
    ) -> None:
        self._core, self._interrupt, self._layout, self._printed = core, interrupt, layout, printed
        self.reset()

    def reset(self) -> None:
        """Go to the state behind power on."""
        self._values: dict[int, int] = {}

    def load(self, offset: int) -> int:
        """Return a register."""
        if offset == self._layout.status:
            return self._layout.ready
        return self._values.get(offset, 0)

    def store(self, offset: int, value: int) -> None:
        """Write a register."""
        if offset == self._layout.data:
            self._printed(value & 0xFF)
            return
        self._values[offset] = value
        if offset == self._layout.control:
            self._core.hold_line(self._interrupt, is_active=bool(value & (_TXE | _TC)))
