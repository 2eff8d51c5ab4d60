"""The devices of a bench on Modbus, too."""

from hil_bench.ability import Ability, Verb

_HERE = "hil_bench.abilities.modbus"

ABILITY = Ability(
    "modbus",
    verbs={
        "registers": Verb(
            "bus", 110, "print the register maps of the Modbus units", f"{_HERE}.verbs"
        ),
    },
    options={"run": f"{_HERE}.run_options"},
    gives={"arguments": f"{_HERE}.run_options"},
    tables={"modbus": f"{_HERE}.section:ModbusSection"},
    bench_methods={"modbus_link": f"{_HERE}.link:modbus_link"},
)
