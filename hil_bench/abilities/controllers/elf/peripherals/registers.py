"""Registers of a peripheral, 32 bits each."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from hil_bench.abilities.controllers.elf.cells import Cells


class Peripheral(ABC):
    """A model that answers for a range of addresses.

    Attributes:
        cells: registers that need it not, where it has some.
    """

    cells: Cells | None = None

    @abstractmethod
    def load(self, offset: int) -> int:
        """Return a register, as a read of it gives.

        Args:
            offset: of it, a multiple of 4.
        """

    @abstractmethod
    def store(self, offset: int, value: int) -> None:
        """Write a register.

        Args:
            offset: of it, a multiple of 4.
            value: all 32 bits.
        """

    @abstractmethod
    def reset(self) -> None:
        """Go to the state behind power on."""

    def read(self, offset: int, size: int) -> int:
        """Return some bytes of a register as a number."""
        value = self.load(offset & ~3)
        if size == 4:
            return value
        return value >> (offset & 3) * 8 & (1 << size * 8) - 1

    def write(self, offset: int, size: int, value: int) -> None:
        """Write some bytes of a register."""
        if size != 4:
            shift = (offset & 3) * 8
            mask = (1 << size * 8) - 1 << shift
            value = self.load(offset & ~3) & ~mask | value << shift & mask
        self.store(offset & ~3, value)


class Follow(NamedTuple):
    """Bits of status that follow bits of control at once, such as a clock's ready bit its enable.

    Attributes:
        control: offset of the register that is written.
        mask: the bits there, from bit 0.
        at: place of the lowest of them.
        status: offset of the register that follows.
        to: place of the lowest bit there.
    """

    control: int
    mask: int
    at: int
    status: int
    to: int


class Followers(Peripheral):
    """Registers that keep what is written, and status bits that follow it.

    Args:
        follows: the status bits.
        initial: values behind power on, by offset; 0 for the others.
    """

    def __init__(self, follows: Sequence[Follow], initial: Mapping[int, int]) -> None:
        self._follows, self._initial = follows, initial
        self.values: dict[int, int] = {}
        self.reset()

    def load(self, offset: int) -> int:
        """Return the value that was written, with the bits that follow."""
        return self.values.get(offset, 0)

    def store(self, offset: int, value: int) -> None:
        """Keep a value, and have its followers follow."""
        self.values[offset] = value
        for each in self._follows:
            if each.control == offset:
                bits = value >> each.at & each.mask
                kept = self.values.get(each.status, 0) & ~(each.mask << each.to)
                self.values[each.status] = kept | bits << each.to

    def reset(self) -> None:
        """Go to the values behind power on."""
        self.values = dict(self._initial)
