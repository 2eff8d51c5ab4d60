"""Two units, the rows that they show, and the loop's end of the mailbox."""

from types import SimpleNamespace

import pytest
from support.registers import register

from hil_bench.abilities.modbus.protocol.mailbox import Mailbox
from hil_bench.abilities.modbus.protocol.register_map import (
    DATA_TYPES,
    DeviceIdentification,
    RegisterAccess,
    RegisterMap,
    Table,
)
from hil_bench.abilities.modbus.protocol.unit_image import UnitImage
from hil_bench.abilities.modbus.server.register_server import RegisterServer

MAP = RegisterMap(
    "map.toml",
    "pressure_404",
    DeviceIdentification("maker", "PT-1", "1.0"),
    (
        register("value", Table.INPUT_REGISTERS, 0, "value", data_type=DATA_TYPES["int32"]),
        register(
            *("offset", Table.HOLDING_REGISTERS, 0, "offset", RegisterAccess.WRITE),
            data_type=DATA_TYPES["int16"],
        ),
    ),
)


class Rig:
    """A server, the loop that feeds it, and the time."""

    def __init__(self):
        self.now = 100.0
        self.row = SimpleNamespace(sequence=1, values=(65538.0, 7.0, -1.0, 8.0))
        self.mailbox = Mailbox()
        units = {1: UnitImage(MAP, 0, commands=True), 2: UnitImage(MAP, 2, commands=True)}
        self.server = RegisterServer(units, self, self.mailbox, lambda: self.now)

    def read(self):
        return self.row

    def tick(self, *values, code=0):
        """One tick of the loop: obey an order, publish."""
        order = self.mailbox.take()
        if order is not None:
            self.mailbox.answer(order.number, code)
        sequence = self.row.sequence + 1 if self.row else 1
        self.row = SimpleNamespace(sequence=sequence, values=values or self.row.values)
        return order

    def serve(self, count=1):
        """Ticks of the loop, and a look of the server at each."""
        for _ in range(count):
            self.tick()
            self.server.poll()


@pytest.fixture
def rig():
    return Rig()


@pytest.fixture(scope="session")
def make_rig():
    """Makes a new one for each example of a property."""
    return Rig
