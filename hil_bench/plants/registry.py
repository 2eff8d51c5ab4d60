"""The kinds of plants: the bench's own, and those of the entry points ``hil_bench.plants``."""

from typing import Any, Final

from hil_bench.plants.fmu.kind import FMU
from hil_bench.plants.hydraulic_cylinder.kind import HYDRAULIC_CYLINDER
from hil_bench.plants.plant import PlantKind
from hil_bench.plants.rotary.kind import ROTARY
from hil_bench.registry import Registry, find_twice


def _find_fault(kind: PlantKind[Any]) -> str:
    """Return the first fault of a plant from elsewhere; empty if it has no fault."""
    if twice := find_twice(key.name for key in kind.keys):
        return f"has the key {twice} twice; give each key its own name"
    if twice := find_twice(quantity.name for quantity in kind.quantities):
        return f"declares the quantity {twice} twice; give each quantity its own name"
    commands = [quantity.name for quantity in kind.quantities if quantity.output is None]
    if len(commands) != 1:
        return f"has {len(commands)} quantities without an output; one, its command, is right"
    if not kind.outputs_in(kind.command.unit):
        return f"shows nothing in {kind.command.unit}; an output must follow its {commands[0]}"
    return ""


PLANTS: Final = Registry[PlantKind[Any]](
    "hil_bench.plants",
    PlantKind,  # type: ignore[type-abstract]
    {kind.name: kind for kind in (HYDRAULIC_CYLINDER, ROTARY, FMU)},
    _find_fault,
)

DEFAULT_PLANT: Final = HYDRAULIC_CYLINDER
"""That of an axis whose table has no `kind`."""
