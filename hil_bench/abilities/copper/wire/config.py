"""The configuration of a simulated bus in `bench.toml`."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from hil_bench.abilities.copper.wire.station import Order

CONTROLLER: Final = "controller"
"""Name of the station that sends what comes from outside the bench."""


@dataclass(frozen=True, slots=True)
class BufferConfig:
    """The transmission buffer of a station.

    Attributes:
        depth: frames that it holds.
        order: which of them goes to arbitration.
    """

    depth: int
    order: Order


@dataclass(frozen=True, slots=True)
class WireConfig:
    """A bus of copper.

    Attributes:
        buffer: of the stations that have none of their own.
        buffers: of stations, by their names.
        bit_error_rate: chance of each bit on the bus to be disturbed.
        recovery: time from bus-off until the software of a node asks for its recovery [s].
    """

    buffer: BufferConfig
    buffers: Mapping[str, BufferConfig] = field(default_factory=dict)
    bit_error_rate: float = 0.0
    recovery: float = 0.0

    def buffer_of(self, name: str) -> BufferConfig:
        """Return the buffer of a station."""
        return self.buffers.get(name, self.buffer)
