"""Cylinders of a bench that one call moves on."""

import struct
from collections.abc import Callable, Sequence
from typing import Any, Final, TypeGuard, cast

from hil_bench.plants.hydraulic_cylinder.cylinder import FullOrderCylinder
from hil_bench.plants.hydraulic_cylinder.model.constants import ROW
from hil_bench.plants.hydraulic_cylinder.model.moving import (
    bind_group,
    is_machine_code,
    make_plant_row,
    piece_of,
)
from hil_bench.plants.hydraulic_cylinder.model.side_by_side import (
    ALL_MOVED,
    BLOCK,
    NONE_MOVED,
    SEEN,
    STATE,
    move_group,
)
from hil_bench.plants.plant import Plant

FEWEST: Final = 3
"""Cylinders for which a call for all is cheaper than one for each."""


class CylinderGroup:
    """Cylinders on one bench: those without extensions move side by side, the others one by one.

    Args:
        cylinders: of the bench, in the order of the axes.
    """

    def __init__(self, cylinders: Sequence[Plant]) -> None:
        self._cylinders = tuple(cylinders)
        self._arrange()

    def drive(self, commands: Sequence[float], steps: int) -> Sequence[Sequence[float]]:
        """Move the cylinders on, each under its spool set-point [m]."""
        if not self._single:
            return self._side_by_side.drive(commands, steps)
        outputs: list[Sequence[float]] = [()] * len(commands)
        given = [commands[place] for place in self._joined]
        moved = self._side_by_side.drive(given, steps)
        for place, output in zip(self._joined, moved, strict=True):
            outputs[place] = output
        for place in self._single:
            outputs[place] = self._cylinders[place].drive(commands[place], steps)
        return outputs

    def _arrange(self) -> None:
        """Find which cylinders can move side by side; again when one of them can no longer."""
        plain = [cylinder for cylinder in self._cylinders if is_plain(cylinder)]
        if len(plain) < FEWEST:
            plain = []
        self._joined = [n for n, each in enumerate(self._cylinders) if each in plain]
        self._single = [n for n, each in enumerate(self._cylinders) if each not in plain]
        self._side_by_side = SideBySide(plain, self._arrange)


class SideBySide:
    """Cylinders without extensions whose rows lie one behind another.

    Args:
        cylinders: they keep their states and constants there from now on.
        leave: called when one of them no longer does.
    """

    def __init__(self, cylinders: Sequence[FullOrderCylinder], leave: Callable[[], None]) -> None:
        self._cylinders = tuple(cylinders)
        count = self._count = len(cylinders)
        rows = max(count, 1)  # no memory has a shape without rows
        commands, states, constants, seen, block = (
            make_plant_row([0.0] * size)
            for size in (2 * count, count * STATE, count * ROW, rows * SEEN, BLOCK)
        )
        self._commands = memoryview(cast("Any", commands))
        self._write = struct.Struct(f"={2 * count}d").pack_into
        self._seen = memoryview(cast("Any", seen)).cast("B").cast("d", (rows, SEEN))
        for number, cylinder in enumerate(cylinders):
            state = piece_of(states, number * STATE, STATE)
            cylinder.move_rows(state, piece_of(constants, number * ROW, ROW), leave)
        self._move = bind_group(move_group, commands, states, constants, seen, block)
        self.drive([0.0] * count, 0)

    def drive(self, commands: Sequence[float], steps: int) -> Sequence[Sequence[float]]:
        """Move the cylinders on, each under its spool set-point [m].

        A command that is not finite and a solver that has diverged are refused.
        """
        cylinders = self._cylinders
        if not cylinders:
            return []
        self._write(self._commands, 0, *commands, *[cylinder.load for cylinder in cylinders])
        moved = self._move(self._count, steps)
        if moved == NONE_MOVED:
            return [
                cylinder.drive(command, steps)
                for cylinder, command in zip(cylinders, commands, strict=True)
            ]
        if moved != ALL_MOVED:
            cylinders[moved].drive(commands[moved], 0)  # which refuses its state
        outputs = cast("list[list[float]]", self._seen.tolist())  # of two dimensions
        for cylinder, seen in zip(cylinders, outputs, strict=True):
            cylinder.seen = seen
        return outputs


def is_plain(cylinder: Plant) -> TypeGuard[FullOrderCylinder]:
    """Return True if a plant is a cylinder that can move side by side with others."""
    return isinstance(cylinder, FullOrderCylinder) and not cylinder.is_extended


def group_cylinders(cylinders: Sequence[Plant]) -> CylinderGroup | None:
    """Return a group of cylinders; None where too few can move side by side."""
    if not is_machine_code() or sum(map(is_plain, cylinders)) < FEWEST:
        return None
    return CylinderGroup(cylinders)
