"""Registers that give the same command, and which of them a client means.

Many PLCs write all outputs in each cycle, as one block, whether the program uses them or not. Where
a map has two registers for one command (the set-point as a float and as an integer; `enable` and
`control_word`), such a block holds a command and, beside it, a value that nobody means. So within a
block a value that is as the client last wrote it gives no command while its rival rules, and a
value that has changed makes its register the one that rules. A request for one value alone is
always meant.
"""

from collections.abc import Iterable, Mapping, Sequence

from hil_bench.abilities.modbus.protocol.assignment import Assignment
from hil_bench.abilities.modbus.protocol.register_map import Register, RegisterAccess

_STATE_COMMANDS = {"enable", "control_word"}
"""Two ways to lead a valve through its states."""


def find_rivals(registers: Iterable[tuple[int, Register]]) -> Mapping[int, int]:
    """Return the positions of the registers that give a command which others give too.

    Args:
        registers: of one unit, with their positions in the row of all values.

    Returns:
        For each of them the first position of its command.
    """
    commands: dict[str, list[int]] = {}
    for position, register in registers:
        if register.access is not RegisterAccess.READ:
            source = register.source
            command = "state" if source in _STATE_COMMANDS else source.upper().removesuffix(".00")
            commands.setdefault(command, []).append(position)
    return {
        position: positions[0]
        for positions in commands.values()
        if len(positions) > 1
        for position in positions
    }


class ClientMemory:
    """The last values that one client wrote to rival registers, in any unit."""

    def __init__(self) -> None:
        self._last: dict[int, float] = {}
        self._ruling: dict[int, int] = {}

    def choose(
        self, assignments: Sequence[Assignment], rivals: Mapping[int, int]
    ) -> list[Assignment]:
        """Take note of what a request writes, and return what of it is meant.

        Args:
            assignments: of the request.
            rivals: as of `find_rivals`.
        """
        in_block = len(assignments) > 1
        return [
            assignment
            for assignment in assignments
            if assignment.position not in rivals
            or self._is_meant(assignment, rivals[assignment.position], in_block=in_block)
        ]

    def _is_meant(self, assignment: Assignment, command: int, *, in_block: bool) -> bool:
        position, value = assignment.position, assignment.value
        has_changed = value != self._last.get(position, 0.0)
        if has_changed or not in_block:
            self._last[position] = value
            self._ruling[command] = position
            return True
        return self._ruling.get(command, position) == position
