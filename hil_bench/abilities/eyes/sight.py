"""The description of one frame, or of the last frame of a transfer, in words."""

from collections.abc import Callable
from enum import StrEnum
from typing import Final, NamedTuple

from hil_bench.abilities.eyes.transfers import Transfer
from hil_bench.abilities.eyes.values import Reading
from hil_bench.canopen_device.frame import Frame

LENGTH_OF_EMCY: Final = 8


class Service(StrEnum):
    """The service that a frame belongs to; filters name it so."""

    NMT = "nmt"
    SYNC = "sync"
    TIME = "time"
    EMCY = "emcy"
    PDO = "pdo"
    SDO = "sdo"
    HEARTBEAT = "heartbeat"
    LSS = "lss"
    J1939 = "j1939"
    OTHER = "other"


class J1939Message(NamedTuple):
    """A message of SAE J1939, in one frame or put together from several.

    Attributes:
        group: its PGN.
        source: address of the sender.
        destination: address of the receiver; 255 for all.
        data: what it carries; None where it did not arrive.
        begin: when its first frame came [ns].
        receiver: what `destination` is called; empty for all.
        shown: the known signals in it, each with the indicator that it shows: "error",
            "not available", or nothing for a value.
        culprit: address of the one who did not do what was due where it did not arrive; None for
            nobody.
        is_answer: for an address claim that somebody has asked for, or commanded, just before.
    """

    group: int
    source: int
    destination: int
    data: bytes | None
    begin: int
    receiver: str = ""
    shown: tuple[tuple[str, str], ...] = ()
    culprit: int | None = None
    is_answer: bool = False


class Sight(NamedTuple):
    """One line on what was on the bus.

    Attributes:
        now: when [ns].
        frame: the frame, of a transfer its last one.
        service: that it belongs to.
        name: of the service, as in ``TPDO1``.
        node: whom it comes from or goes to; empty for all.
        node_id: of that node; None for all.
        said: the same as `words`, or what puts them together.
        readings: the values that it carries.
        problem: what is wrong with it; empty for nothing.
        transfer: the SDO transfer that it ends.
        message: the J1939 message that it is.
    """

    now: int
    frame: Frame
    service: Service
    name: str
    node: str = ""
    node_id: int | None = None
    said: str | Callable[[], str] = ""
    readings: tuple[Reading, ...] = ()
    problem: str = ""
    transfer: Transfer | None = None
    message: J1939Message | None = None

    @property
    def words(self) -> str:
        """The words for it, beside the values that it carries."""
        return self.said if isinstance(self.said, str) else self.said()

    @property
    def emcy_code(self) -> int | None:
        """The emergency error code; None where this is no whole EMCY message."""
        data = self.frame.data
        if self.service is not Service.EMCY or len(data) != LENGTH_OF_EMCY or self.frame.is_remote:
            return None
        return data[0] | data[1] << 8

    @property
    def text(self) -> str:
        """The description, in one line."""
        text = ", ".join(filter(None, (self.words, *map(str, self.readings))))
        if self.problem:
            text = f"{text}  ! {self.problem}" if text else f"! {self.problem}"
        return text
