"""The kinds of plants: the bench's own, and those of the entry points ``hil_bench.plants``."""

from typing import Any, Final

from hil_bench.plants.hydraulic_cylinder.kind import HYDRAULIC_CYLINDER
from hil_bench.plants.kind import PlantKind
from hil_bench.registry import Registry

PLANTS: Final = Registry[PlantKind[Any]](
    "hil_bench.plants",
    PlantKind,  # type: ignore[type-abstract]
    {kind.name: kind for kind in (HYDRAULIC_CYLINDER,)},
)

DEFAULT_PLANT: Final = HYDRAULIC_CYLINDER
"""That of an axis whose table has no `kind`."""
