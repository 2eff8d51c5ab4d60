"""The independent watchdog of STM32 (reference manual RM0440, chapter 41)."""

from collections.abc import Callable
from typing import Final

from hil_bench.abilities.controllers.elf.peripherals.registers import Peripheral
from hil_bench.abilities.controllers.elf.timeline import Alarm, Core

ADDRESS: Final = 0x4000_3000
"""Of its registers, on each of the chips."""

_KR, _PR, _RLR, _WINR = 0x00, 0x04, 0x08, 0x10
_START, _FEED, _UNLOCK = 0xCCCC, 0xAAAA, 0x5555
_LARGEST = 0xFFF


class Watchdog(Peripheral):
    """A watchdog that resets the chip unless it is fed in time; nothing stops it but a reset.

    Args:
        core: of the chip.
        clock_hz: frequency of its oscillator, LSI [Hz].
        bite: resets the chip; is given the reason in words.
    """

    def __init__(self, core: Core, clock_hz: int, bite: Callable[[str], None]) -> None:
        self._core, self._clock_hz, self._bite = core, clock_hz, bite
        self.reset()

    def reset(self) -> None:
        """Go to the state behind a reset: it waits for its start."""
        self._values = {_PR: 0, _RLR: _LARGEST, _WINR: _LARGEST}
        self._is_open = self._is_on = False
        self._fed_at = 0  # [ns]
        self._alarm: Alarm | None = None

    def load(self, offset: int) -> int:
        """Return a register; values are taken over at once, so its status is always 0."""
        return self._values.get(offset, 0)

    def store(self, offset: int, value: int) -> None:
        """Write a register, the protected ones where the key has opened them."""
        if offset != _KR:
            if self._is_open and offset in self._values:
                self._values[offset] = value & (7 if offset == _PR else _LARGEST)
            return
        key = value & 0xFFFF
        self._is_open = key == _UNLOCK
        if key == _START and not self._is_on:
            self._is_on = True
            self._feed()
        elif key == _FEED and self._is_on:
            left = self._values[_RLR] - (self._core.now() - self._fed_at) // self._duration(1)
            if left > self._values[_WINR]:
                self._bite("was fed too early")
            else:
                self._feed()

    def _duration(self, counts: int) -> int:
        """Return the time of some counts [ns]."""
        return counts * (4 << min(self._values[_PR], 6)) * 1_000_000_000 // self._clock_hz

    def _feed(self) -> None:
        if self._alarm is not None:
            self._alarm.cancel()
        self._fed_at = self._core.now()
        patience = self._duration(self._values[_RLR] + 1)
        words = f"was not fed for {patience * 1e-6:.3g} ms"
        self._alarm = self._core.alarm(self._fed_at + patience, lambda: self._bite(words))
