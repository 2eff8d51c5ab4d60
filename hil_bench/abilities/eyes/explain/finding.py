"""A finding in a log, and the interface of a watch that finds it."""

from collections.abc import Collection, Iterable, Iterator
from enum import Enum
from typing import NamedTuple, Protocol

from hil_bench.abilities.eyes.sight import Service, Sight

EVIDENCE = 3
"""Frames that a finding shows."""


class Evidence(list[Sight]):
    """The first frames that show something, and how many there were.

    A log may show it a million times, so no more than `EVIDENCE` are kept.

    Attributes:
        total: of all frames.
        latest: the last one; None before the first.
    """

    def __init__(self, sights: Iterable[Sight] = ()) -> None:
        super().__init__()
        self.total = 0
        self.latest: Sight | None = None
        for sight in sights:
            self.append(sight)

    def append(self, sight: Sight) -> None:
        """Count a frame, and keep it where it is one of the first."""
        self.total += 1
        self.latest = sight
        if self.total <= EVIDENCE:
            super().append(sight)


def more(count: int, sign: str = ";") -> str:
    """Return the words for what came so many times in all; empty for once."""
    return f"{sign} {count - 1} times more" if count > 2 else f"{sign} once more" * (count > 1)


def listed(names: Collection[str]) -> str:
    """Return the first names, and how many more there are."""
    shown = ", ".join(list(names)[:EVIDENCE])
    return f"{shown} and {len(names) - EVIDENCE} more" if len(names) > EVIDENCE else shown


def together(parts: Iterable[Evidence]) -> Evidence:
    """Return the evidence of one fault that shows in several places: the first frame of each."""
    every = list(parts)
    if len(every) == 1:
        return every[0]
    found = Evidence(each[0] for each in every)
    found.total = sum(each.total for each in every)
    return found


class Cause(Enum):
    """The possible causes, in the order in which an expert looks, each with its clause and advice.

    `hypotheses` says which of them lead to which.
    """

    OTHER_BUS = (
        "none of the known nodes is here",
        "CiA 301, 7.2.8.3.3",
        "take the bench.toml or the EDS files of this bus",
    )
    TWO_RECORDINGS = (
        "two recordings are interleaved",
        "docs/bus.md",
        "explain each recording alone",
    )
    TWO_BUSES = (
        "two buses are in one log",
        "docs/bus.md",
        "explain each bus alone; give each recording a channel of its own",
    )
    BUS_SILENT = (
        "the whole bus falls silent",
        "ISO 11898-1",
        "look at cable, termination and supply of all, or at the adapter that recorded",
    )
    NO_BOOT_UP = (
        "no boot-up",
        "CiA 301, 7.2.8.3.3",
        "look at its supply, its bit rate, its plug and its node-ID",
    )
    NODE_ID_CLASH = (
        "two devices have one node-ID",
        "CiA 301, 7.2.4 and 7.2.8.3.3",
        "give one of them another node-ID, by its switches or by LSS",
    )
    IDENTIFIER_CLASH = (
        "two nodes send one identifier",
        "CiA 301, 7.5.2.37",
        "give one of the PDOs another COB-ID",
    )
    NAME_CLASH = (
        "two J1939 devices have one NAME",
        "SAE J1939-81",
        "give one of them another identity number or instance",
    )
    ADDRESS_CLASH = (
        "two J1939 devices want one address",
        "SAE J1939-81",
        "give one of them another preferred address",
    )
    WRONG_LENGTH = (
        "messages of a length that CANopen does not have",
        "CiA 301, 7.2",
        "find who sends this identifier; a device may ignore such a message",
    )
    ERROR_FRAMES = (
        "error frames",
        "ISO 11898-1",
        "look at bit rates, termination, cable length and screen",
    )
    BUS_LOAD = (
        "bus load",
        "ISO 11898-1",
        "find who floods it; lengthen event and inhibit times, or raise the bit rate",
    )
    RESTART = (
        "restarts by itself",
        "CiA 301, 7.2.8.3.3",
        "look at its supply and its watchdog",
    )
    J1939_RESTART = (
        "a J1939 device restarts by itself",
        "SAE J1939-81",
        "look at its supply and its watchdog",
    )
    OTHER_DEVICE = (
        "is not what its EDS says",
        "CiA 301, 7.4.1 and 7.5.2.21",
        "take the EDS of this device and revision",
    )
    MAPPING = (
        "mapping does not go with the device",
        "CiA 301, 7.5.2.36 and 7.5.2.38",
        "compare the mapping objects of both sides",
    )
    PDO_TIMERS = (
        "inhibit time of a PDO is above its event timer",
        "CiA 301, 7.5.2.37",
        "set the inhibit time below the event timer",
    )
    SYNC_TWICE = (
        "two devices produce SYNC",
        "CiA 301, 7.2.5.1 and 7.5.2.5",
        "clear bit 30 of 0x1005 in one of them",
    )
    SYNC_COUNTER = (
        "SYNC has a counter for some and not for others",
        "CiA 301, 7.2.5.3.1 and 7.5.2.22",
        "write one value to 0x1019 of the producer and of all that follow it",
    )
    SYNC_PERIOD = (
        "SYNC has another period than 0x1006 says",
        "CiA 301, 7.2.5 and 7.5.2.6",
        "write one period to the producer and to 0x1006 of all",
    )
    NOT_STARTED = (
        "is not started",
        "CiA 301, 7.2.8.3.1",
        "have the master send NMT start",
    )
    START_REFUSED = (
        "does not follow an NMT command",
        "CiA 301, 7.2.8.3.1 and 7.3.2.2",
        "read its error register and history (0x1001, 0x1003)",
    )
    HEARTBEAT_LOST = (
        "heartbeat lost",
        "CiA 301, 7.2.8.3.2.2",
        "look at its supply, its plug, and whether it goes bus-off",
    )
    J1939_SILENT = (
        "a J1939 device falls silent",
        "SAE J1939-71",
        "look at its supply, its plug, and whether it goes bus-off",
    )
    SDO_LATE = (
        "SDO answer comes too late",
        "CiA 301, 7.2.4.3.17",
        "lengthen the client's time-out, or ask less often",
    )
    SDO_SHARED = (
        "SDO requests that do not wait for each other",
        "CiA 301, 7.2.4.2",
        "let one client ask at a time, or give the other a channel of its own (0x1201)",
    )
    SDO_ABORT = (
        "SDO transfer aborted",
        "CiA 301, 7.2.4.3.17",
        "correct the request, or the EDS that it was made by",
    )
    SDO_NO_ANSWER = (
        "SDO request not answered",
        "CiA 301, 7.2.4",
        "look whether the node has this SDO server, and at its identifiers",
    )
    EMCY = ("EMCY", "CiA 301, 7.2.7.1", "look the code up in the manual of the device")
    STATE_LEFT = (
        "leaves OPERATIONAL by itself",
        "CiA 301, 7.3.2.2 and 7.5.2.33",
        "read its error register and history (0x1001, 0x1003), and its error behaviour (0x1029)",
    )
    J1939_TRANSFER = (
        "a long J1939 message does not arrive",
        "SAE J1939-21",
        "look which packet is missing, and at the load",
    )
    J1939_REQUEST = (
        "J1939 request refused or not answered",
        "SAE J1939-21",
        "look whether the device has this parameter group",
    )
    J1939_PACE = (
        "packets of a long J1939 message come too fast or too slowly",
        "SAE J1939-21",
        "look at the transport protocol of the sender",
    )
    PDO_LENGTH = (
        "length of a PDO differs from its mapping",
        "CiA 301, 7.2.7.1 (8210h, 8220h)",
        "compare the mappings of sender and receiver",
    )
    PDO_CHECKSUM = (
        "checksum of a protected PDO is wrong",
        "SAE J1850, CRC-8",
        "look whether both sides protect the same bytes",
    )
    PDO_REPEATED = (
        "counter of a protected PDO stands",
        "docs/devices.md",
        "the application of the sender stands; look why",
    )
    PDO_LOST = (
        "counter of a protected PDO jumps",
        "docs/devices.md",
        "look at the load, and at buffers that overrun",
    )
    ABSENT_PRODUCER = (
        "waits for a producer that is not there",
        "CiA 301, 7.5.2.5, 7.5.2.19 and 7.5.2.35",
        "start the producer, or take the consumer's entry out",
    )
    SYNC_MISSING = ("SYNC missing", "CiA 301, 7.2.5", "look at the SYNC producer and its 0x1005")
    SYNC_JITTER = (
        "SYNC jitters",
        "CiA 301, 7.2.5",
        "give the producer's task a higher priority, or the SYNC a lower identifier",
    )
    RPDO_TIMEOUT = ("RPDO time-out", "CiA 301, 7.5.2.35", "look at the cycle of the sender")
    PDO_MISSING = ("a PDO stays out", "CiA 301, 7.5.2.37", "look at the sender's application")
    J1939_MISSING = (
        "a J1939 message stays out",
        "SAE J1939-71 and -73",
        "look at the sender's application",
    )
    J1939_PERIOD = (
        "a J1939 message leaves its period",
        "SAE J1939-71",
        "look at the sender's application, and at the load",
    )
    J1939_LENGTH = (
        "the length of a J1939 message changes",
        "SAE J1939-21 and -71",
        "look at the sender's software version",
    )
    J1939_PRIORITY = (
        "the priority of a J1939 message changes",
        "SAE J1939-21",
        "look at the sender's software version",
    )
    TROUBLE_CODE = ("trouble code", "SAE J1939-73", "look the code up in the manual of the device")
    J1939_INDICATOR = (
        "a J1939 signal shows an error, or is not available any more",
        "SAE J1939-71",
        "look at the sensor behind the signal",
    )

    def __init__(self, title: str, clause: str, advice: str) -> None:
        self.title = title
        self.clause = clause
        self.advice = advice


class Finding(NamedTuple):
    """Something that is wrong.

    Attributes:
        cause: the kind.
        node: with which node; empty for the bus.
        begin: since when [ns].
        text: in a sentence.
        sights: the first frames that show it.
        total: of all such frames; 0 for as many as `sights`.
        others: node-IDs that it is also about: the producer that is awaited.
        span: how late it may be seen after what it comes from [ns].
        consequences: what it explains.
    """

    cause: Cause
    node: str
    begin: int
    text: str
    sights: tuple[Sight, ...] = ()
    total: int = 0
    others: tuple[str, ...] = ()
    span: int = 0
    consequences: tuple["Finding", ...] = ()

    @property
    def unshown(self) -> int:
        """Frames that show it beyond `sights`; what is missing on a bus is shown by none."""
        return max(self.total - len(self.sights), 0) if self.sights else 0


class Watch(Protocol):
    """Looks for one kind of trouble."""

    hears: frozenset[Service]
    """The services of which it wants to hear."""

    def hear(self, sight: Sight) -> None:
        """Take what was on the bus, in order."""

    def pause(self, length: int) -> None:
        """Take note that nothing at all was heard for a time: nobody was late in it.

        Args:
            length: of the pause [ns].
        """

    def findings(self, end: int) -> Iterator[Finding]:
        """Yield what is wrong so far; the watch stays as it is.

        Args:
            end: of the log [ns].

        Yields:
            The findings.
        """


def finding(
    cause: Cause, node: str, evidence: Evidence, text: str, begin: int | None = None
) -> Finding:
    """Return a finding with its evidence; it begins with the first frame, or when `begin` says."""
    since = evidence[0].now if begin is None else begin
    return Finding(cause, node, since, text, tuple(evidence), evidence.total)


def seconds(time: int) -> str:
    """Return a time [ns] for people."""
    return f"{time * 1e-9:.3f} s"


_LONG = 10_000_000_000


def milliseconds(duration: float) -> str:
    """Return a duration [ns] for people; from ten seconds on in seconds."""
    if duration < _LONG:
        return f"{duration * 1e-6:.4g} ms"
    return f"{duration * 1e-9:.{1 if duration < 100 * _LONG else 0}f} s"
