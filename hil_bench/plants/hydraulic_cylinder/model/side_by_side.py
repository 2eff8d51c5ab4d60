"""Plants of a bench stepped side by side in vector registers, by the kernels of a single one.

A block holds one number of each of its plants, then the next number, as in `model.batch`. Each
plant gives the same bits as alone. One call takes all plants of a group: it fills blocks from their
rows, steps each block, and writes states and what is seen back.
"""

import math
from typing import Final

from hil_bench.plants.hydraulic_cylinder.model.constants import ROW, Constants, unpack_lane
from hil_bench.plants.hydraulic_cylinder.model.implicit_midpoint import (
    Cylinder,
    move_cylinder,
    try_free_step,
)
from hil_bench.plants.hydraulic_cylinder.model.kernel import Floats, kernel
from hil_bench.plants.hydraulic_cylinder.model.parts import TOLERANCE
from hil_bench.plants.hydraulic_cylinder.model.spool import move_spool
from hil_bench.plants.hydraulic_cylinder.model.state import (
    PLAIN_EXTRA,
    PlantOutput,
    PlantState,
    show,
)
from hil_bench.plants.hydraulic_cylinder.model.stepping import LOAD_LIMIT, SPOOL_SETPOINT_LIMIT

WIDTH: Final = 8
"""Plants in a block: a register of eight, or two of four."""

SEEN: Final = len(PlantOutput._fields)
"""Numbers that are seen of a plant."""

STATE: Final = PLAIN_EXTRA + 1
"""Numbers in the row of states of a plant without extensions."""

ALL_MOVED: Final = -1
NONE_MOVED: Final = -2
"""What `move_group` returns beside the number of a plant."""

_STATES: Final = len(PlantState._fields)
_SETPOINT: Final = _STATES  # places in a block
_LOAD: Final = _SETPOINT + 1
_CONSTANTS: Final = _LOAD + 1
_NEXT: Final = _CONSTANTS + ROW
_ERROR: Final = _NEXT + _STATES

BLOCK: Final = (_ERROR + 1) * WIDTH
"""Numbers in a block."""


@kernel
def cylinder_among(block: Floats, lane: int, width: int) -> Cylinder:
    """Return the cylinder of one plant of a block of `width` at the start of the step."""
    return (
        block[lane],
        block[width + lane],
        block[2 * width + lane],
        block[3 * width + lane],
        block[6 * width + lane],
        block[7 * width + lane],
    )


@kernel
def try_among(
    block: Floats, lane: int, width: int, u: float, F_L: float, constants: Constants
) -> tuple[Cylinder, float, float, float]:
    """Return the cylinder, nu and nu_dot of one plant a step later, and the velocity's error.

    The error is infinite where a cavity is or opens.

    Args:
        block: of the plants, which begins with their states.
        lane: of the plant.
        width: plants in the block.
        u: spool set-point [m].
        F_L: external load [N].
        constants: of the plant, in their groups.
    """
    nu, nu_dot = block[4 * width + lane], block[5 * width + lane]
    moved, moved_dot = move_spool(nu, nu_dot, u, constants[3])
    cylinder = cylinder_among(block, lane, width)
    cylinder, error = try_free_step(cylinder, (nu, moved), F_L, constants)
    return cylinder, moved, moved_dot, error


@kernel
def _try_lane(block: Floats, lane: int) -> tuple[Cylinder, float, float, float]:
    constants = unpack_lane(block, _CONSTANTS * WIDTH + lane, WIDTH)
    u, F_L = block[_SETPOINT * WIDTH + lane], block[_LOAD * WIDTH + lane]
    return try_among(block, lane, WIDTH, u, F_L, constants)


@kernel
def _move_lane(block: Floats, lane: int) -> tuple[Cylinder, int]:
    """Return the cylinder of one plant a step later, made in parts, and evaluations."""
    constants = unpack_lane(block, _CONSTANTS * WIDTH + lane, WIDTH)
    spool = (block[4 * WIDTH + lane], block[(_NEXT + 4) * WIDTH + lane])
    cylinder = cylinder_among(block, lane, WIDTH)
    return move_cylinder(cylinder, spool, block[_LOAD * WIDTH + lane], constants)


@kernel
def are_within(commands: Floats, count: int) -> bool:
    """Return True if all set-points and loads are such that the plant takes them as they are."""
    for plant in range(count):
        u, F_L = commands[plant], commands[count + plant]
        if not (abs(u) <= SPOOL_SETPOINT_LIMIT and abs(F_L) <= LOAD_LIMIT):
            return False
    return True


@kernel
def fill_block(
    block: Floats, first: int, commands: Floats, states: Floats, constants: Floats, count: int
) -> None:
    """Fill a block with the plants from `first` on, and what is left of it with the last one.

    Other arguments as of `move_group`.
    """
    for lane in range(WIDTH):
        plant = min(first + lane, count - 1)
        for place in range(_STATES):
            block[place * WIDTH + lane] = states[plant * STATE + place]
        block[_SETPOINT * WIDTH + lane] = commands[plant]
        block[_LOAD * WIDTH + lane] = commands[count + plant]
        for place in range(ROW):
            block[(_CONSTANTS + place) * WIDTH + lane] = constants[plant * ROW + place]


@kernel
def step_block(block: Floats, first: int, used: int, states: Floats) -> None:
    """Move the plants of a block on by one step.

    Args:
        block: of the plants.
        first: number of its first plant.
        used: how many of its plants are to be made in parts where need be.
        states: of all plants, where extra evaluations are counted.
    """
    then = _NEXT * WIDTH
    for lane in range(WIDTH):
        (x, v, P_A, P_B, V_CA, V_CB), nu, nu_dot, error = _try_lane(block, lane)
        block[then + lane], block[then + WIDTH + lane] = x, v
        block[then + 2 * WIDTH + lane], block[then + 3 * WIDTH + lane] = P_A, P_B
        block[then + 4 * WIDTH + lane], block[then + 5 * WIDTH + lane] = nu, nu_dot
        block[then + 6 * WIDTH + lane], block[then + 7 * WIDTH + lane] = V_CA, V_CB
        block[then + _STATES * WIDTH + lane] = error
    for lane in range(used):
        if block[then + _STATES * WIDTH + lane] > TOLERANCE:
            (x, v, P_A, P_B, V_CA, V_CB), evaluations = _move_lane(block, lane)
            block[then + lane], block[then + WIDTH + lane] = x, v
            block[then + 2 * WIDTH + lane], block[then + 3 * WIDTH + lane] = P_A, P_B
            block[then + 6 * WIDTH + lane], block[then + 7 * WIDTH + lane] = V_CA, V_CB
            states[(first + lane) * STATE + PLAIN_EXTRA] += evaluations - 1
    for place in range(_STATES * WIDTH):
        block[place] = block[then + place]


@kernel
def keep_lane(block: Floats, lane: int, plant: int, states: Floats, seen: Floats) -> bool:
    """Write the states of a plant back, and what is seen of them; whether they are finite.

    Args:
        block: of the plant.
        lane: of the plant.
        plant: its number.
        states: of all plants.
        seen: of all plants.
    """
    for place in range(_STATES):
        states[plant * STATE + place] = block[place * WIDTH + lane]
    constants = unpack_lane(block, _CONSTANTS * WIDTH + lane, WIDTH)
    x, v, P_A, P_B, V_CA, V_CB = cylinder_among(block, lane, WIDTH)
    nu, nu_dot = block[4 * WIDTH + lane], block[5 * WIDTH + lane]
    shown = show((x, v, P_A, P_B, nu, nu_dot, V_CA, V_CB), constants[2], constants[4])
    at = plant * SEEN
    seen[at], seen[at + 1], seen[at + 2], seen[at + 3] = shown[:4]
    seen[at + 4], seen[at + 5], seen[at + 6], seen[at + 7] = shown[4:]
    return math.isfinite(x + v + P_A + P_B)


@kernel
def move_group(
    commands: Floats,
    states: Floats,
    constants: Floats,
    seen: Floats,
    block: Floats,
    count: int,
    steps: int,
) -> int:
    """Move plants without extensions on by some steps of the linearly implicit midpoint rule.

    Args:
        commands: spool set-points of all plants [m], then external loads of all [N].
        states: `STATE` numbers of the first plant, then of the next, moved on in place.
        constants: `ROW` numbers of the first plant, then of the next.
        seen: takes `SEEN` numbers of the first plant, then of the next.
        block: room for a block.
        count: of plants.
        steps: how many.

    Returns:
        `ALL_MOVED`; `NONE_MOVED` where a command is not within the limits; the number of a plant
        that has left the finite numbers.
    """
    if not are_within(commands, count):
        return NONE_MOVED
    moved = ALL_MOVED
    for first in range(0, count, WIDTH):
        fill_block(block, first, commands, states, constants, count)
        used = min(count - first, WIDTH)
        for _ in range(steps):
            step_block(block, first, used, states)
        for lane in range(used):
            if not keep_lane(block, lane, first + lane, states, seen):
                moved = first + lane
    return moved
