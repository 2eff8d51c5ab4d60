"""Controllers of every kind on the bench's clock."""

from hil_bench.ability import Ability

ABILITY = Ability(
    "controllers",
    options={"run": "hil_bench.abilities.controllers.verbs.run_options"},
    tables={"controllers": "hil_bench.abilities.controllers.section:ControllersSection"},
)
