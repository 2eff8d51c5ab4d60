"""A kind of fault: a spring loses a part of its stiffness."""

from hil_bench.abilities.faults.fault import Effect
from hil_bench.abilities.faults.kind import GROWTH, Site, fault_kind, percent
from hil_bench.abilities.faults.plant_kinds import wear
from hil_bench.abilities.faults.points import PLANTS


@fault_kind(
    PLANTS, keys=(percent("loss_percent", "share", 100.0), GROWTH), defects="lost_stiffness"
)
def fatigue(axis: Site, share: float = 1.0, *, growth: float = 0.0) -> Effect:
    """Let a spring lose a share of its stiffness."""
    return wear(axis, share, growth)
