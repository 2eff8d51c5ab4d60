"""Numbers of a Cortex-M's exceptions (Armv7-M ARM, B1.5)."""

from typing import Final

RESET, NMI, HARD_FAULT, SVCALL, PENDSV, SYSTICK = 1, 2, 3, 11, 14, 15
FIRST_INTERRUPT: Final = 16
THREAD_PRIORITY: Final = 256
"""The priority of code outside of exceptions: any exception is more urgent."""
