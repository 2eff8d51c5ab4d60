"""A master that polls as the OpenPLC runtime does (thiagoralves/OpenPLC_v3, modbus_master.cpp).

Each cycle it goes through its devices and asks each for all of its areas, in this order: function 2
for the discrete inputs, 15 for the coils, 4 for the input registers, 3 and then 16 for the holding
registers; an area of size 0 is left out. It writes all outputs in every cycle, whether the program
has changed them or not. On TCP any exception or time-out closes the device's connection, so the
rest of its requests fail too; the next cycle opens it again. Then it sleeps for the polling period,
100 ms by default. The time-out of a response is 1 s.
"""

import struct
from dataclasses import dataclass, field

from hil_drivers.modbus import ModbusClient
from hil_drivers.modbus.client import ModbusExceptionError
from hil_drivers.modbus.framing import TcpFraming

POLLING_PERIOD, TIMEOUT = 0.1, 1.0


@dataclass
class Device:
    """One entry of its list of devices: sizes of the areas, which all begin at 0, and their images.

    `refused` has the exceptions that came, `opened` says how often a connection was opened.
    """

    client: ModbusClient
    unit_id: int
    discrete_inputs: int = 0
    input_registers: int = 0
    holding_read: int = 0
    coils: list[bool] = field(default_factory=list)
    holding: list[int] = field(default_factory=list)
    bits: list[bool] = field(default_factory=list)
    inputs: list[int] = field(default_factory=list)
    held: list[int] = field(default_factory=list)
    refused: list[str] = field(default_factory=list)
    opened: int = 0
    is_connected: bool = False

    def poll(self):
        if not self.is_connected:
            self.is_connected = True
            self.opened += 1
        if self.discrete_inputs:
            answer = self._ask(struct.pack(">BHH", 2, 0, self.discrete_inputs))
            self.bits = unpack_bits(answer, self.discrete_inputs) or self.bits
        if self.coils:
            raw = pack_bits(self.coils)
            self._ask(struct.pack(">BHHB", 15, 0, len(self.coils), len(raw)) + raw)
        if self.input_registers:
            answer = self._ask(struct.pack(">BHH", 4, 0, self.input_registers))
            self.inputs = unpack_words(answer) or self.inputs
        if self.holding_read:
            answer = self._ask(struct.pack(">BHH", 3, 0, self.holding_read))
            self.held = unpack_words(answer) or self.held
        if self.holding:
            count = len(self.holding)
            words = struct.pack(f">{count}H", *self.holding)
            self._ask(struct.pack(">BHHB", 16, 0, count, 2 * count) + words)

    def _ask(self, pdu):
        if not self.is_connected:
            return None
        try:
            return self.client.request(self.unit_id, pdu)
        except ModbusExceptionError as error:
            self.refused.append(str(error))
            self.client.close()
            self.is_connected = False
            return None


def openplc(bench, sizes):
    """Return its devices: one connection each, by unit-ID, with the given sizes."""
    return {
        unit_id: Device(
            ModbusClient(bench.modbus_link(TcpFraming()), clock=bench.now, timeout=TIMEOUT),
            unit_id,
            **{
                **size,
                "coils": [False] * size.get("coils", 0),
                "holding": [0] * size.get("holding", 0),
            },
        )
        for unit_id, size in sizes.items()
    }


def run_openplc(bench, devices, program, duration):
    """Poll for some bench time [s], with a scan of the program between two cycles."""
    end = bench.now() + duration
    while bench.now() < end:
        for device in devices.values():
            device.poll()
        program(devices)
        bench.run(POLLING_PERIOD)


def pack_bits(bits):
    raw = bytearray((len(bits) + 7) // 8)
    for number, bit in enumerate(bits):
        raw[number // 8] |= bit << number % 8
    return bytes(raw)


def unpack_bits(answer, count):
    if answer is None:
        return None
    return [bool(answer[2 + number // 8] >> number % 8 & 1) for number in range(count)]


def unpack_words(answer):
    return None if answer is None else list(struct.unpack(f">{answer[1] // 2}H", answer[2:]))
