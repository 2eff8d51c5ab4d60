"""Divisions by zero as traps, where a program asks for them (CCR.DIV_0_TRP, Armv7-M ARM, B3.2.8).

Unicorn's core divides by zero and gets zero, as one without that bit. So each division is hooked,
at its address, once the bit is set: while unicorn counts instructions it walks its list of hooks at
each of them, and 30 hooks make a chip a third slower.
"""

import re
from collections.abc import Callable, Iterable, Mapping
from functools import partial

from hil_bench.abilities.controllers.elf.elf_file import Segment
from hil_bench.abilities.controllers.elf.engine import Engine

_DIVISION = re.compile(rb"(?=[\x90-\x9f\xb0-\xbf]\xfb[\xf0-\xff][\xf0-\xff])")  # SDIV, UDIV


def find_divisors(segments: Iterable[Segment]) -> dict[int, int]:
    """Return the number of the divisor's register by the address of each division.

    Data that looks like a division is among them; a core never comes there.
    """
    return {
        address + found.start(): data[found.start() + 2] & 0xF
        for address, data in segments
        for found in _DIVISION.finditer(data)
        if not (address + found.start()) & 1
    }


class DivisionTraps:
    """The traps of a core.

    Args:
        engine: of the core.
        divisors: of its program; see `find_divisors`.
        take: is called in front of a division, with the number of its divisor's register.

    Attributes:
        is_on: whether the program asks for them.
    """

    def __init__(
        self, engine: Engine, divisors: Mapping[int, int], take: Callable[[int], None]
    ) -> None:
        self._engine, self._divisors, self._take = engine, dict(divisors), take
        self.is_on = False

    @property
    def are_due(self) -> bool:
        """Return True if they are asked for and there are no hooks yet."""
        return self.is_on and bool(self._divisors)

    def hook(self) -> None:
        """Hook all divisions, while the core does not run."""
        for address, register in self._divisors.items():
            self._engine.hook_address(address, partial(self._look, register))
        self._divisors.clear()
        self._engine.forget_translations()

    def _look(self, register: int) -> None:
        if self.is_on:
            self._take(register)
