"""Lock-step: bench time is the count of a controller's SYNCs, and firmware on the bench's bus."""

from hil_bench.ability import Ability

ABILITY = Ability("lockstep")
