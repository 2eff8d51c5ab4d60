"""Exceptions of a Cortex-M: pending, enabled, active, and which comes first (Armv7-M ARM, B1.5)."""

from typing import Final

RESET, NMI, HARD_FAULT, SVCALL, PENDSV, SYSTICK = 1, 2, 3, 11, 14, 15
FIRST_INTERRUPT: Final = 16
THREAD_PRIORITY: Final = 256
"""The priority of code outside of exceptions: any exception is more urgent."""

_ALWAYS = sum(1 << number for number in (NMI, HARD_FAULT, SVCALL, PENDSV, SYSTICK))


class Exceptions:
    """The state of all exceptions.

    Args:
        priority_bits: of a priority that the chip has.
        interrupts: that the chip has.

    Attributes:
        pending: a bit for each number of an exception.
        enabled: likewise.
        lines: of interrupts whose peripheral asks for them, likewise.
        active: numbers of those that have begun, the last one last.
        priorities: by number; lower is more urgent.
        group_bits: of a priority below its point, which do not preempt.
    """

    def __init__(self, priority_bits: int, interrupts: int) -> None:
        self._mask = 0xFF00 >> priority_bits & 0xFF
        self.count = FIRST_INTERRUPT + interrupts
        self.reset()

    def reset(self) -> None:
        """Begin anew, with nothing pending and no interrupt enabled."""
        self.pending = self.lines = 0
        self.enabled = _ALWAYS
        self.active: list[int] = []
        self.priorities = [0] * self.count
        self.priorities[RESET : HARD_FAULT + 1] = [-3, -2, -1]
        self.group_bits = 1

    def set_priority(self, number: int, value: int) -> None:
        """Set the priority of an exception, as far as the chip has bits for it."""
        if number > HARD_FAULT and number < self.count:
            self.priorities[number] = value & self._mask

    def masked(self, value: int) -> int:
        """Return a priority as far as the chip has bits for it."""
        return value & self._mask

    @property
    def priority(self) -> int:
        """The priority at which code runs now, masks left aside."""
        if not self.active:
            return THREAD_PRIORITY
        return min(self.group_of(self.priorities[number]) for number in self.active)

    def find_due(self, ceiling: int) -> int:
        """Return the exception that preempts now, 0 for none.

        Args:
            ceiling: the priority that it has to be below.
        """
        waiting = self.pending & self.enabled
        best, urgency = 0, ceiling
        while waiting:
            lowest = waiting & -waiting
            waiting ^= lowest
            number = lowest.bit_length() - 1
            group = self.group_of(self.priorities[number])
            if group < urgency or (
                best and group == urgency and self.priorities[number] < self.priorities[best]
            ):
                best, urgency = number, group
        return best

    def begin(self, number: int) -> None:
        """Take note that an exception is entered."""
        self.pending &= ~(1 << number)
        self.active.append(number)

    def end(self) -> None:
        """Take note that the last one is over; one whose line is still active comes again."""
        number = self.active.pop()
        self.pending |= self.lines & (1 << number)

    def hold_line(self, number: int, *, is_active: bool) -> None:
        """Set the level of the line of an exception."""
        bit = 1 << number
        if not is_active:
            self.lines &= ~bit
            return
        if not self.lines & bit:
            self.lines |= bit
            self.pending |= bit

    def group_of(self, priority: int) -> int:
        """Return the part of a priority that preempts."""
        return priority if priority < 0 else priority >> self.group_bits << self.group_bits
