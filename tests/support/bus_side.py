"""A whole bench in virtual time, driven by frames."""

import struct

from hil_bench.bench.assembly import build_bench
from hil_bench.bench.configuration import load_config
from hil_bench.canopen_device.frame import Frame

TICK = 1_000_000  # [ns]
VALVE, PRESSURE_A, PRESSURE_B, POSITION = 1, 2, 3, 4  # node-IDs of the built-in bench
CONTROLLER = 0x77
SYNC = Frame(0x080)
START_ALL = Frame(0x000, b"\x01\x00")


def download_request(node_id, index, subindex, raw):
    """Return an expedited SDO download of up to four bytes."""
    command = 0x23 | (4 - len(raw)) << 2
    data = struct.pack("<BHB", command, index, subindex) + raw.ljust(4, b"\0")
    return Frame(0x600 + node_id, data)


def valve_command(control_word, setpoint):
    """Return the valve's RPDO 1; set-point in 1/16384 of full opening."""
    return Frame(0x200 + VALVE, struct.pack("<Hh", control_word, setpoint))


class BusSide:
    """The controller's side of the wire: frames in, frames out, a tick at a time."""

    def __init__(self, config=None):
        self.bench = build_bench(config or load_config())
        self.now = 0
        self.log = []
        self.bench.start(self.now)

    @property
    def plant(self):
        return self.bench.axes[0].plant

    def tick(self, *frames, count=1):
        """Deliver frames with the first of some ticks; return what all of them sent."""
        sent = []
        for number in range(count):
            self.now += TICK
            sent += self.bench.tick(frames if number == 0 else (), self.now)
        self.log += sent
        return sent

    def nmt(self, command, node_id=0):
        return self.tick(Frame(0x000, bytes([command, node_id])))

    def command(self, control_word, setpoint, *, count=1):
        """Send the valve's RPDO 1 with each of some ticks; set-point in 1/16384 of full opening."""
        frame = valve_command(control_word, setpoint)
        return [sent for _ in range(count) for sent in self.tick(frame)]

    def download(self, node_id, index, subindex, raw):
        """Write an object by expedited SDO; return the answer."""
        sent = self.tick(download_request(node_id, index, subindex, raw))
        return next(frame.data for frame in sent if frame.can_id == 0x580 + node_id)

    def activate(self):
        """Boot all nodes and bring the valve to ACTIVE."""
        self.tick()
        self.nmt(0x01)
        self.command(0x0007, 0)
