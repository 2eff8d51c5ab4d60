"""Where a Modbus server is found: all that its process needs to know of a configuration."""

from dataclasses import dataclass
from enum import StrEnum


class Parity(StrEnum):
    """Parity of a serial line."""

    EVEN = "even"
    ODD = "odd"
    NONE = "none"


@dataclass(frozen=True, slots=True)
class SerialConfig:
    """A serial line that Modbus RTU is spoken on.

    Attributes:
        port: its device file, as in ``/dev/ttyUSB0``; ``pty`` for a new pseudo-terminal.
        baud_rate: bit rate [bit/s].
        parity: of each character.
        stop_bits: of each character.
    """

    port: str
    baud_rate: int
    parity: Parity
    stop_bits: int


@dataclass(frozen=True, slots=True)
class ServerConfig:
    """The ways in.

    Attributes:
        is_on_tcp: whether it listens on TCP.
        host: address to listen on.
        port: TCP port; 0 for a free one.
        connections: most connections at a time.
        serial: the serial line, None for none.
    """

    is_on_tcp: bool
    host: str
    port: int
    connections: int
    serial: SerialConfig | None
