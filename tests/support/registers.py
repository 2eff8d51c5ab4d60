"""Registers of Modbus in a line."""

from hil_bench.abilities.modbus.protocol.register_map import Register, RegisterAccess


def register(name, table, address, source, access=RegisterAccess.READ, **more):
    return Register(name=name, table=table, address=address, source=source, access=access, **more)
