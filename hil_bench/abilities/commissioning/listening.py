"""Listens to a bus without sending anything."""

from dataclasses import dataclass, field

import can

from hil_bench.abilities.eyes.frame_words import meaning_of
from hil_bench.canopen_device.identifiers import function_of
from hil_bench.frame import bits_of
from hil_bench.outside.messages import frame_of
from hil_drivers import Network


@dataclass(slots=True)
class Traffic:
    """The frames of one identifier.

    Attributes:
        can_id: the identifier.
        is_extended: whether it has 29 bits.
        frames: how many came.
        data: of the last.
        is_remote: whether the last was a remote frame.
    """

    can_id: int
    is_extended: bool
    frames: int = 0
    data: bytes = b""
    is_remote: bool = False

    @property
    def function(self) -> str:
        """The function of the identifier in the predefined connection set."""
        return "not CANopen" if self.is_extended else function_of(self.can_id).name

    @property
    def node_id(self) -> int | None:
        """The node that it belongs to by default."""
        return None if self.is_extended else function_of(self.can_id).node_id

    @property
    def meaning(self) -> str:
        """The meaning of the last frame."""
        if self.is_remote:
            return "remote frame"
        return "" if self.is_extended else meaning_of(self.can_id, self.data)


@dataclass(slots=True)
class BusTraffic:
    """The traffic of a bus during a time of listening.

    Attributes:
        duration: how long that was [s].
        bits: on the bus, with the expected number of stuff bits.
        error_frames: reported by the adapter.
        identifiers: their traffic, by identifier and whether it has 29 bits.
    """

    duration: float = 0.0
    bits: float = 0.0
    error_frames: int = 0
    identifiers: dict[tuple[int, bool], Traffic] = field(default_factory=dict)

    @property
    def frames(self) -> int:
        """All frames but error frames."""
        return sum(traffic.frames for traffic in self.identifiers.values())

    def load(self, bitrate: int) -> float:
        """Return the share of the bus's time that was taken, at a bit rate [bit/s]."""
        return self.bits / (bitrate * self.duration) if self.duration > 0.0 else 0.0

    def take(self, message: can.Message) -> None:
        """Count one frame."""
        if message.is_error_frame:
            self.error_frames += 1
            return
        key = (message.arbitration_id, message.is_extended_id)
        traffic = self.identifiers.setdefault(key, Traffic(*key))
        traffic.frames += 1
        traffic.data, traffic.is_remote = bytes(message.data), message.is_remote_frame
        frame = frame_of(message)
        self.bits += 0.0 if frame is None else bits_of(frame)


def listen(network: Network, duration: float) -> BusTraffic:
    """Return the traffic received within a time [s]; nothing is sent."""
    traffic = BusTraffic()
    network.observe = traffic.take
    begin = network.now()
    try:
        network.pump(duration)
    finally:
        network.observe = None
    traffic.duration = network.now() - begin
    return traffic
