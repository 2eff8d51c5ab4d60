"""Controllers of every kind on the bench's clock."""

from hil_bench.ability import Ability

_SEAM = "hil_bench.abilities.controllers.seam"

ABILITY = Ability(
    "controllers",
    options={"run": "hil_bench.abilities.controllers.verbs.run_options"},
    fixtures="hil_bench.abilities.controllers.fixtures",
    registries={"kind of controller": "hil_bench.abilities.controllers.kinds:CONTROLLERS"},
    exports={
        "Controller": _SEAM,
        "ControllerEnd": _SEAM,
        "ControllerKind": _SEAM,
        "Surroundings": _SEAM,
        "TimedFrame": _SEAM,
    },
    tables={"controllers": "hil_bench.abilities.controllers.section:ControllersSection"},
)
