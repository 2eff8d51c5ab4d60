"""What the devices of a bus say, in SI units, from their TPDOs alone."""

from collections.abc import Callable
from typing import NamedTuple

import can

from drivers import Network, PositionSensor, PressureSensor, ProportionalValve
from drivers.device import Device
from hil_bench.config import (
    BenchConfig,
    EncoderConfig,
    NodeConfig,
    PressureConfig,
    ValveConfig,
)
from hil_bench.virtual_bench import VirtualBench


class Reading(NamedTuple):
    """One quantity of one axis as a device reports it.

    Attributes:
        axis: its name.
        quantity: "position", "P_A", "P_B" or "spool_position".
        device: the driver that decodes it.
        value: what it says now, in SI; of the spool, in full openings.
    """

    axis: str
    quantity: str
    device: Device
    value: Callable[[], float]


class Decoder:
    """The drivers of a bench's devices, told frames that somebody overheard.

    How a device maps and scales its values is taken from the configuration: the drivers ask a
    virtual bench of the same configuration for it, so nothing is sent to the machine.

    Args:
        config: the bench.

    Attributes:
        readings: all quantities that can be decoded.
    """

    def __init__(self, config: BenchConfig) -> None:
        self._time = 0.0
        with VirtualBench(config, recorded_time=0.1, logged_frames=1) as bench:
            # Bench time stands still once all is set up; from then on, the frames' time counts.
            self._network = Network(bench.bus, clock=lambda: bench.now() + self._time)
            self.readings = [
                reading for node in config.nodes if node.axis for reading in self._readings(node)
            ]
        self._seen = {reading: -float("inf") for reading in self.readings}

    def take(self, message: can.Message, time: float) -> list[Reading]:
        """Take a frame of the bus and return which quantities it brought.

        Args:
            message: the frame.
            time: when it was on the bus, from the first one [s].
        """
        self._time = time
        self._network.deliver(message)
        fresh = []
        for reading in self.readings:
            received_at = reading.device.received_at
            if received_at > self._seen[reading]:
                self._seen[reading] = received_at
                fresh.append(reading)
        return fresh

    def _readings(self, node: NodeConfig) -> list[Reading]:
        axis, place = str(node.axis), (self._network, node.node_id, node.eds)
        match node:
            case PressureConfig():
                pressure = PressureSensor(*place)
                pressure.setup(transmission_type=254)
                return [Reading(axis, node.source.value, pressure, lambda: pressure.pressure)]
            case EncoderConfig():
                position = PositionSensor(*place)
                position.setup(transmission_type=254)
                return [Reading(axis, "position", position, lambda: position.position)]
            case ValveConfig():
                valve = ProportionalValve(*place)
                valve.setup(transmission_type=254)
                return [Reading(axis, "spool_position", valve, lambda: valve.spool_position)]
            case _:
                return []
