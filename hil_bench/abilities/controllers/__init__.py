"""Controllers of every kind on the bench's clock."""

from hil_bench.ability import Ability

ABILITY = Ability("controllers")
