"""A kernel together with the rows that it moves on, by whatever makes kernels fast here."""

import math
from array import array
from collections.abc import Callable, Sequence
from typing import Any, cast

from hil_bench.plants.hydraulic_cylinder.model.kernel import IS_COMPILED, Floats, make_row, ready
from hil_bench.plants.hydraulic_cylinder.model.machine_code import find_machine_code
from hil_bench.plants.hydraulic_cylinder.model.state import Seen

Advance = Callable[[Floats, Floats, float, float, int], Seen]
"""A stepping kernel: it takes states, constants, u [m], F_L [N] and steps."""

Move = Callable[[float, float, int], Seen]
"""The same with its rows. It raises FloatingPointError where the states are not finite then."""


def is_machine_code() -> bool:
    """Return True if stepping kernels run as machine code, made by Numba now or before."""
    return IS_COMPILED or find_machine_code().bind is not None


def describe_kernels() -> str:
    """Return the kind of kernels in use, and why those of the wheel are not used."""
    carried = find_machine_code()
    if carried.bind is not None:
        return str(carried)
    unused = f"; those of the wheel are not used: {carried.refusal}" if carried.refusal else ""
    return ("compiled by Numba" if IS_COMPILED else "interpreted") + unused


def make_plant_row(values: Sequence[float]) -> Floats:
    """Return a row for `bind_advance` or `bind_group`."""
    if find_machine_code().bind is None:
        return make_row(values)
    return array("d", values)


def piece_of(row: Floats, first: int, size: int) -> Floats:
    """Return a piece of such a row, in the same memory; not of a list."""
    shared = memoryview(row) if isinstance(row, array) else row
    return cast("Floats", shared[first : first + size])  # type: ignore[index]  # arrays have slices


def bind_advance(advance: Advance, state: Floats, constants: Floats) -> Move:
    """Return a function that moves a row of states on."""
    bind = find_machine_code().bind
    if bind is not None:
        return bind(advance.__name__, state, constants)
    kernel = ready(advance)

    def move(u: float, F_L: float, steps: int) -> Seen:
        seen = kernel(state, constants, u, F_L, steps)
        if not math.isfinite(seen[0] + seen[1] + seen[2] + seen[3]):
            raise FloatingPointError("the state is not finite")
        return seen

    return move


def bind_group(kernel: Callable[..., int], *rows: Floats) -> Callable[[int, int], int]:
    """Return a function that moves a group of plants on, given their count and steps."""
    bind = find_machine_code().bind
    if bind is not None:
        return bind(kernel.__name__, *rows)
    compiled: Callable[..., Any] = ready(kernel)
    return lambda count, steps: compiled(*rows, count, steps)
