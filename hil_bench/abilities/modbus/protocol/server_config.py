"""The configuration of a Modbus server's process: its addresses, its line and its TLS files."""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path


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
class TlsConfig:
    """Modbus/TCP Security on the TCP port; all files are PEM.

    Attributes:
        certificate: of the server, with what leads to its authority.
        key: of that certificate, without a password.
        client_ca: the authorities that clients' certificates must come from.
        writer_role: the role in a client's certificate that may write; the others read.
    """

    certificate: Path
    key: Path
    client_ca: Path
    writer_role: str


@dataclass(frozen=True, slots=True)
class ServerConfig:
    """The ways in.

    Attributes:
        is_on_tcp: whether it listens on TCP.
        host: address to listen on.
        port: TCP port; 0 for a free one.
        connections: most connections at a time.
        serial: the serial line, None for none.
        tls: certificates and roles for TCP; None for plain TCP.
        default_unit: unit-ID of the device that unit-IDs 0 and 255 reach on TCP; None for none.
    """

    is_on_tcp: bool
    host: str
    port: int
    connections: int
    serial: SerialConfig | None
    tls: TlsConfig | None = None
    default_unit: int | None = None
