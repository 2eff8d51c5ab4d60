"""Timers and watchdogs."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Final

from hil_bench.abilities.controllers.elf.cells import COUNTED, KEPT, READ, make_cells
from hil_bench.abilities.controllers.elf.core_view import Core
from hil_bench.abilities.controllers.elf.peripherals.registers import Peripheral

if TYPE_CHECKING:
    from hil_bench.abilities.controllers.elf.calls import Alarm

# Timers of STM32: they count up, and report their update and four compare values.

_CR1, _DIER, _SR, _EGR, _CNT, _PSC, _ARR = 0x00, 0x0C, 0x10, 0x14, 0x24, 0x28, 0x2C
_CEN, _UDIS, _URS, _OPM = 1, 2, 4, 8
_UIF = 1
_CCR = (0x34, 0x38, 0x3C, 0x40)
_PLACES = (_ARR, *_CCR)  # whose counts are alarms
_FOLLOWED = (_CR1, _EGR, _CNT, _ARR)  # that its count follows
_MEANT = 0x1F  # flags of the update and the four compares


class Timer(Peripheral):
    """A timer that counts up.

    Args:
        core: of the chip.
        interrupt: number of its interrupt.
        frequency: asks for its clock [Hz].
        width: of its counter [bit].
    """

    def __init__(
        self, core: Core, interrupt: int, frequency: Callable[[], int], width: int = 16
    ) -> None:
        self._core, self._interrupt, self._frequency = core, interrupt, frequency
        self._most = (1 << width) - 1
        # A program that writes its deadline in each round needs no model for it.
        kinds = {_SR: READ, _CNT: COUNTED, **dict.fromkeys(_CCR, KEPT)}
        self.cells = cells = make_cells(_CCR[-1] // 4 + 1, kinds)
        self._words, self._ramp = cells.words, cells.ramp
        self._matches = {each: partial(self._match, place) for place, each in enumerate(_CCR)}
        self.reset()

    def reset(self) -> None:
        """Go to the state behind power on."""
        self._values = {_ARR: self._most}
        for register in _CCR:
            self._words[register >> 2] = 0
        self._prescaler = 0  # that counts; PSC is taken over at an update
        self._begin = 0  # when it was at 0 [ns]
        self._held = 0  # its count while it stands
        self._is_counting = False
        self._alarms: dict[int, Alarm] = {}  # by the register that is reached
        self._set_flags(0)
        self.follow()

    def follow(self) -> None:
        """Have the count that a core reads be that of now, and of the clock; see `Cells`."""
        self._hz = self._frequency()
        self._words[_CNT >> 2] = self._held
        ramp = self._ramp
        ramp[0], ramp[1] = self._begin, self._hz
        ramp[2] = 1_000_000_000 * (self._prescaler + 1) if self._is_counting else 0
        ramp[3] = self._values[_ARR]

    def load(self, offset: int) -> int:
        """Return a register."""
        if offset == _SR:
            return self._flags
        return self._count() if offset == _CNT else self._values.get(offset, 0)

    def store(self, offset: int, value: int) -> None:
        """Write a register."""
        if offset == _SR:
            self._set_flags(self._flags & value)
        elif offset == _EGR:
            if value & 1:
                self._held = 0
                self._update(is_forced=True)
        elif offset == _CNT:
            self._held = value & self._most
            self._start()
        elif offset == _CR1:
            self._control(value)
        else:
            self._keep(offset, value)
        if offset in _FOLLOWED:
            self.follow()

    def _keep(self, offset: int, value: int) -> None:
        self._values[offset] = value & self._most if offset == _ARR else value
        if offset in _CCR:
            self._words[offset >> 2] = value
        if offset == _DIER:
            self._raise_line()
        elif offset in _PLACES and self._is_counting:
            held = self._count()
            for register in _PLACES if offset == _ARR else (offset,):
                self._set_alarm(register, held)

    def _control(self, value: int) -> None:
        is_counting = bool(value & _CEN)
        if self._is_counting and not is_counting:
            self._held = self._count()
        self._values[_CR1] = value
        if self._is_counting != is_counting:
            self._is_counting = is_counting
            self._start()

    def _count(self) -> int:
        if not self._is_counting:
            return self._held
        passed = (self._core.now() - self._begin) * self._hz
        count = passed // (1_000_000_000 * (self._prescaler + 1))
        return max(min(count, self._values[_ARR]), 0)  # below, where a clock has become slower

    def _duration(self, counts: int) -> int:
        """Return the time of some counts, so that they are over then [ns]."""
        return -(-counts * (self._prescaler + 1) * 1_000_000_000 // self._hz)

    def _start(self) -> None:
        """Count on from the count that it holds, or stand."""
        if self._is_counting:
            self._turn(self._core.now() - self._duration(self._held), self._held)
        else:
            for alarm in self._alarms.values():
                alarm.cancel()
            self._alarms.clear()

    def _turn(self, begin: int, held: int) -> None:
        """Set the alarms of a turn.

        Args:
            begin: when it was, or would have been, at 0 [ns].
            held: its count now.
        """
        self._begin = begin
        self.follow()
        for register in _PLACES:
            self._set_alarm(register, held)

    def _set_alarm(self, register: int, held: int) -> None:
        """Set the alarm of the end of this turn, or of a compare value that is still to come.

        The turn goes on as it began, whatever is written meanwhile: no part of a count is lost.
        """
        most = self._values[_ARR]
        if register == _ARR:
            count, action, is_ahead = most + 1, self._overflow, most > 0
        else:
            count, action = self._values.get(register, 0), self._matches[register]
            is_ahead = held < count <= most
        time = self._begin + self._duration(count)
        known = self._alarms.get(register)
        if known is not None:
            if known.is_on and is_ahead and known.time == time:
                return
            del self._alarms[register]
            known.cancel()
        if is_ahead:
            self._alarms[register] = self._core.alarm(time, action)

    def _match(self, place: int) -> None:
        self._set_flags(self._flags | 2 << place)

    def _overflow(self) -> None:
        begin = self._begin + self._duration(self._values[_ARR] + 1)
        self._update(is_forced=False)
        if self._values.get(_CR1, 0) & _OPM:
            self._values[_CR1] &= ~_CEN
            self._is_counting = False
            self._held = 0
            self.follow()
            return
        self._turn(begin, -1)

    def _update(self, *, is_forced: bool) -> None:
        control = self._values.get(_CR1, 0)
        if control & _UDIS:
            return
        self._prescaler = self._values.get(_PSC, 0) & 0xFFFF
        if not (is_forced and control & _URS):
            self._set_flags(self._flags | _UIF)
        if is_forced:
            self._start()

    def _set_flags(self, flags: int) -> None:
        self._flags = self._words[_SR >> 2] = flags
        self._raise_line()

    def _raise_line(self) -> None:
        is_active = bool(self._flags & self._values.get(_DIER, 0) & _MEANT)
        self._core.hold_line(self._interrupt, is_active=is_active)


# The independent watchdog of STM32 (reference manual RM0440, chapter 41).

WATCHDOG_ADDRESS: Final = 0x4000_3000
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
