"""The core of a chip, as its peripherals see it."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Final, Protocol

if TYPE_CHECKING:
    from hil_bench.abilities.controllers.elf.calls import Alarm


class Core(Protocol):
    """The core, as its peripherals see it."""

    def now(self) -> int:
        """Return the chip's time, to the instruction [ns]."""

    def alarm(self, time: int, action: Callable[[], None]) -> "Alarm":
        """Have something happen at a time [ns], though a program is running."""

    def pend(self, exception: int) -> None:
        """Make an exception pending."""

    def hold_line(self, interrupt: int, *, is_active: bool) -> None:
        """Set the level of an interrupt's line: pending again for as long as it is active."""


# Numbers of a Cortex-M's exceptions (Armv7-M ARM, B1.5).

RESET, NMI, HARD_FAULT, SVCALL, PENDSV, SYSTICK = 1, 2, 3, 11, 14, 15
FIRST_INTERRUPT: Final = 16
THREAD_PRIORITY: Final = 256
"""The priority of code outside of exceptions: any exception is more urgent."""
