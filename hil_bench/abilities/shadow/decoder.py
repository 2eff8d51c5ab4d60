"""Decoding of a bus' devices, in SI units, from their TPDOs alone."""

import math
from collections.abc import Callable, Iterator
from functools import partial
from pkgutil import resolve_name
from typing import NamedTuple

import can

from hil_bench.bench.configuration import BenchConfig, NodeConfig
from hil_bench.session.virtual_bench import VirtualBench
from hil_drivers import DriverError, Network, PositionSensor, PressureSensor, ProportionalValve
from hil_drivers.device import Device, Input

STATUS_WORD = "status_word"
"""The quantity that a valve's status word is."""


class Reading(NamedTuple):
    """One quantity of one axis as a device reports it.

    Attributes:
        axis: its name.
        quantity: of the plant, or `STATUS_WORD`.
        name: of the device.
        node_id: of the device.
        device: the driver that decodes it.
        source: the PDO that brings it.
        value: what it says now, in SI; of the spool, in full openings.
    """

    axis: str
    quantity: str
    name: str
    node_id: int
    device: Device
    source: Input
    value: Callable[[], float]

    def read(self) -> float:
        """Return the value; NaN while the device has none that is valid."""
        try:
            value = self.value()
        except DriverError:
            return math.nan
        return value if math.isfinite(value) else math.nan


class OverheardDrivers:
    """The drivers of a bench's devices, fed with frames that somebody overheard.

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
        self._seen = dict.fromkeys(self.readings, -math.inf)

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
            received_at = reading.source.pdo.received_at
            if received_at > self._seen[reading]:
                self._seen[reading] = received_at
                if math.isfinite(reading.device.received_at):  # its other PDOs have come, too
                    fresh.append(reading)
        return fresh

    def _readings(self, node: NodeConfig) -> Iterator[Reading]:
        watched = node.kind.watched(node)
        if not watched or node.kind.driver is None:
            return
        # A value may come on two PDOs of different age, the second with its status.
        device: PressureSensor | PositionSensor | ProportionalValve = resolve_name(
            node.kind.driver
        )(self._network, node.node_id, node.eds, max_age=math.inf)
        device.setup(transmission_type=254)
        device.expect_protection(node.protected_tpdos)
        axis = str(node.axis)
        if isinstance(device, ProportionalValve):
            word = device.status
            yield Reading(
                *(axis, STATUS_WORD, node.name, node.node_id, device, word),
                lambda: word.signal.decode(word.pdo.data),
            )
        for quantity, attribute in watched.items():
            yield Reading(
                *(axis, quantity, node.name, node.node_id, device, device.primary),
                partial(getattr, device, attribute),
            )
