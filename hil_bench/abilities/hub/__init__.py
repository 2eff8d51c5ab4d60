"""A bus for other programs where there is no SocketCAN: `run --hub`."""

from hil_bench.ability import Ability

ABILITY = Ability(
    "hub",
    gives={
        "hub": "hil_bench.abilities.hub.hosting",
        "socketcand": "hil_bench.abilities.common.socketcand_bus",
    },
)
