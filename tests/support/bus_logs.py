"""Logs of a bus, made by the bench: a master with four devices, and what goes wrong."""

import contextlib
import struct

from hil_bench.bench.virtual_bench import VirtualBench
from hil_drivers import DriverError, Network, PositionSensor, PressureSensor, ProportionalValve

CYCLE = 0.01


class Rig:
    """A master on a bench in virtual time.

    Args:
        bench: the bench.
        network: on its bus.
    """

    def __init__(self, bench, network):
        self.bench = bench
        self.network = network
        self.faults = bench.faults
        self.valve = ProportionalValve(network, node_id=1)
        self.pressure_a = PressureSensor(network, node_id=2)
        self.pressure_b = PressureSensor(network, node_id=3)
        self.position = PositionSensor(network, node_id=4)
        self.devices = (self.valve, self.pressure_a, self.pressure_b, self.position)
        network.pump(0.05)  # all have booted

    def set_up(self, *devices, transmission_type=254, event_timer=CYCLE, start=True):
        for device in devices or self.devices:
            device.setup(transmission_type=transmission_type, event_timer=event_timer)
            if start:
                self.network.start_node(device.node.id)

    def move(self, duration, *, sync=None):
        """Send a set-point each cycle, and SYNC where a period is given."""
        end, number = self.network.now() + duration, 0
        while self.network.now() < end - 1e-6:
            if sync is not None:
                self.network.sync()
            self.valve.spool_setpoint = 0.3 + 0.01 * (number % 5)
            number += 1
            self.network.pump(sync or CYCLE)

    def write(self, device, index, subindex, value, letter="I"):
        device.node.download(index, subindex, struct.pack(f"<{letter}", value))

    def start(self, **options):
        self.set_up(**options)
        self.valve.enable()
        self.move(0.3, sync=CYCLE if options.get("transmission_type") == 1 else None)


def played(play, config=None):
    """Return the frames of a run that `play` makes of a rig."""
    with VirtualBench(config) as bench, Network(bench.bus, clock=bench.now) as network:
        with contextlib.suppress(DriverError):  # a master gives up where a device is mute
            play(Rig(bench, network))
        return list(bench.frames)
