"""A bench that devices are commanded on from Modbus and from CAN."""

import struct

from support.bus_side import VALVE, BusSide

from hil_bench.abilities.modbus.binding import ModbusBinding
from hil_bench.abilities.modbus.protocol.register_map import ModbusException, Table

PRESSURE_A, POSITION = 2, 4
CONTROL, ENABLE, RESET = 0, 1, 2
INIT, DISABLED, ACTIVE, FAULT_HOLD, LOCAL = 0x08, 0x09, 0x0F, 0x03, 0x10


class ModbusSide(BusSide):
    """A bench with CAN on one side and register tables on the other."""

    def __init__(self, config):
        super().__init__(config)
        self.binding = ModbusBinding(config, self.bench)
        self.plan = self.binding.plan
        self.tick()

    def tick(self, *frames, count=1):
        sent = []
        for number in range(count):
            sent += super().tick(*(frames if number == 0 else ()))
            if hasattr(self, "binding"):
                self.binding.exchange(self.now)
        return sent

    def read(self, unit_id, table, name):
        """Read one value by its name, through the registers."""
        image = self.plan.units[unit_id]
        for _, register in image._tables[table]._registers:
            if register.name == name:
                row = self.plan.rows.read()
                words = image.read(
                    table, register.address, register.count, row.sequence, row.values
                )
                if table.holds_bits:
                    return words[0]
                return register.data_type.decode(words, register.word_order) * register.scale
        raise AssertionError(name)

    def write(self, unit_id, table, address, *words):
        """Write, and tick until it is answered; returns the exception code, 0 for none."""
        try:
            assignments = self.plan.units[unit_id].parse_write(table, address, words)
        except ModbusException as refusal:
            return refusal.code
        number = self.plan.mailbox.post(assignments)
        self.tick()
        assert self.plan.mailbox.answer_of(number) is None
        self.tick()
        return self.plan.mailbox.answer_of(number)

    def coil(self, address, value):
        return self.write(VALVE, Table.COILS, address, value)

    def setpoint(self, fraction):
        words = struct.unpack(">2H", struct.pack(">f", fraction))
        return self.write(VALVE, Table.HOLDING_REGISTERS, 0, *words)

    def status(self):
        return int(self.read(VALVE, Table.INPUT_REGISTERS, "status_word"))
