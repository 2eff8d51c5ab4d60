"""Lock-step: bench time is the count of a controller's SYNCs, and firmware on the bench's bus."""

from hil_bench.ability import Ability

_HERE = "hil_bench.abilities.lockstep"

ABILITY = Ability(
    "lockstep",
    needs=("controllers", "hub"),
    options={"run": f"{_HERE}.run_options", "commission": f"{_HERE}.commission_options"},
    gives={"network": f"{_HERE}.commission_options"},
    bench_methods={"join": f"{_HERE}.firmware:join"},
    fixtures=f"{_HERE}.fixtures",
)
