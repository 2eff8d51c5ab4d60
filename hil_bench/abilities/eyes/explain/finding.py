"""A finding in a log, and the interface of a watch that finds it."""

from collections.abc import Iterator
from enum import Enum
from typing import NamedTuple, Protocol

from hil_bench.abilities.eyes.sight import Sight

EVIDENCE = 3
"""Frames that a finding shows."""


class Cause(Enum):
    """The possible causes, in the order in which an expert looks, each with its clause.

    What may lead to others comes before them: a node that is not there loses heartbeats, answers
    and PDOs, so its absence is what matters.
    """

    OTHER_BUS = "none of the known nodes is here", "CiA 301, 7.2.8.3.3"
    NO_BOOT_UP = "no boot-up", "CiA 301, 7.2.8.3.3"
    NODE_ID_CLASH = "two devices have one node-ID", "CiA 301, 7.2.4 and 7.2.8.3.3"
    IDENTIFIER_CLASH = "two nodes send one identifier", "CiA 301, 7.5.2.37"
    ADDRESS_CLASH = "two J1939 devices want one address", "SAE J1939-81"
    ERROR_FRAMES = "error frames", "ISO 11898-1"
    RESTART = "restarts by itself", "CiA 301, 7.2.8.3.3"
    OTHER_DEVICE = "is not what its EDS says", "CiA 301, 7.4.1 and 7.5.2.21"
    MAPPING = "mapping does not go with the EDS", "CiA 301, 7.5.2.36 and 7.5.2.38"
    NOT_STARTED = "is not started", "CiA 301, 7.2.8.3.1"
    START_REFUSED = "does not follow an NMT command", "CiA 301, 7.2.8.3.1 and 7.3.2.2"
    HEARTBEAT_LOST = "heartbeat lost", "CiA 301, 7.2.8.3.2.2"
    J1939_SILENT = "a J1939 device falls silent", "SAE J1939-71"
    SDO_LATE = "SDO answer comes too late", "CiA 301, 7.2.4.3.17"
    SDO_ABORT = "SDO transfer aborted", "CiA 301, 7.2.4.3.17"
    SDO_NO_ANSWER = "SDO request not answered", "CiA 301, 7.2.4"
    J1939_TRANSFER = "a long J1939 message does not arrive", "SAE J1939-21"
    J1939_REQUEST = "J1939 request refused or not answered", "SAE J1939-21"
    PDO_LENGTH = "length of a PDO differs from its mapping", "CiA 301, 7.2.7.1 (8210h, 8220h)"
    PDO_CHECKSUM = "checksum of a protected PDO is wrong", "SAE J1850, CRC-8"
    PDO_REPEATED = "counter of a protected PDO stands", "docs/devices.md"
    PDO_LOST = "counter of a protected PDO jumps", "docs/devices.md"
    PDO_MISSING = "a PDO stays out", "CiA 301, 7.5.2.37"
    J1939_MISSING = "a J1939 message stays out", "SAE J1939-71 and -73"
    ABSENT_PRODUCER = "waits for a producer that is not there", "CiA 301, 7.5.2.19 and 7.5.2.35"
    RPDO_TIMEOUT = "RPDO time-out", "CiA 301, 7.5.2.35"
    SYNC_MISSING = "SYNC missing", "CiA 301, 7.2.5"
    SYNC_JITTER = "SYNC jitters", "CiA 301, 7.2.5"
    EMCY = "EMCY", "CiA 301, 7.2.7.1"
    TROUBLE_CODE = "trouble code", "SAE J1939-73"
    BUS_LOAD = "bus load", "ISO 11898-1"

    def __init__(self, title: str, clause: str) -> None:
        self.title = title
        self.clause = clause


class Finding(NamedTuple):
    """Something that is wrong.

    Attributes:
        cause: what.
        node: with which node; empty for the bus.
        begin: since when [ns].
        text: in a sentence.
        sights: frames that show it.
    """

    cause: Cause
    node: str
    begin: int
    text: str
    sights: tuple[Sight, ...] = ()


class Watch(Protocol):
    """Looks for one kind of trouble."""

    def hear(self, sight: Sight) -> None:
        """Take what was on the bus, in order."""

    def findings(self, end: int) -> Iterator[Finding]:
        """Yield what is wrong, once the log has ended.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """


def seconds(time: int) -> str:
    """Return a time [ns] for people."""
    return f"{time * 1e-9:.3f} s"


def milliseconds(duration: float) -> str:
    """Return a duration [ns] for people."""
    return f"{duration * 1e-6:.4g} ms"
