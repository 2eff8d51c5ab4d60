"""Faults of a bench: of its sensors, valves, supplies, plants, nodes and buses."""

from hil_bench.ability import Ability

_HERE = "hil_bench.abilities.faults"

ABILITY = Ability(
    "faults",
    tables={"faults": f"{_HERE}.section:FaultsSection"},
    standing=("faults",),
    bench_attributes={"faults": f"{_HERE}.faults:faults_of"},
    fixtures=f"{_HERE}.fixtures",
    registries={"kind of fault": f"{_HERE}.registry:FAULT_KINDS"},
    exports={"Faults": f"{_HERE}.faults"},
    options={"run": f"{_HERE}.options", "check": f"{_HERE}.options"},
    gives={
        "arguments": f"{_HERE}.options",
        "attached": f"{_HERE}.attached",
        "ctl": f"{_HERE}.ctl",
        "feed": f"{_HERE}.requests",
    },
)
