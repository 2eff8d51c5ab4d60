"""SDO transfers overheard on the bus: from their frames to one object with its bytes (CiA 301)."""

import struct
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

_ABORT: Final = 0x80
_LAST: Final = 0x80

PATIENCE: Final = 1_000_000_000
"""Time without a frame after which a transfer counts as given up [ns]."""

AT_ONCE: Final = 100_000_000
"""Time within which the request of another client may overtake one that is not answered [ns]."""

LARGEST: Final = 1 << 20
"""Bytes of a transfer that are kept; what follows is counted."""


class Way(Enum):
    """The direction of a transfer: an upload reads the value, a download writes it."""

    UPLOAD = "upload"
    DOWNLOAD = "download"
    UNSEEN = "transfer of"
    """Of one that began before the log, and is aborted in it."""


@dataclass(slots=True)
class Transfer:
    """One SDO transfer.

    Attributes:
        way: read or write.
        index: of the object.
        subindex: of the object.
        begin: time of its first frame [ns].
        end: time of its latest frame [ns].
        frames: how many there were.
        data: the value's bytes so far.
        announced: length that was announced; None for none.
        abort: abort code; None where it was not aborted.
        is_aborted_by_client: who aborted.
        is_done: whether it came to its good end.
        is_answered: whether the server has said anything.
        is_overtaken: whether another request came before its answer.
        is_last: whether the last of its data has been seen.
        block: the segments of the block that is under way; None outside of one.
    """

    way: Way
    index: int
    subindex: int
    begin: int
    end: int = 0
    frames: int = 1
    data: bytearray = field(default_factory=bytearray)
    announced: int | None = None
    abort: int | None = None
    is_aborted_by_client: bool = False
    is_done: bool = False
    is_answered: bool = False
    is_overtaken: bool = False
    is_last: bool = False
    block: list[bytes] | None = None

    @property
    def place(self) -> str:
        """The object, as in ``0x6130.01``."""
        return f"0x{self.index:04X}.{self.subindex:02X}"

    @property
    def has_ended(self) -> bool:
        """True if no more frames belong to the transfer."""
        return self.is_done or self.abort is not None

    @property
    def is_short(self) -> bool:
        """True if the transfer ended with another length than was announced."""
        return self.is_done and self.announced is not None and self.announced != len(self.data)


class SdoChannel:
    """The transfers of one client-server channel.

    Attributes:
        current: the transfer that is under way, None for none.
        overtaken: one whose answer is still to come, though another was begun; None for none.
    """

    def __init__(self) -> None:
        self.current: Transfer | None = None
        self.overtaken: Transfer | None = None
        self._has_begun = False

    def hear(self, data: bytes, now: int, *, is_request: bool) -> tuple[Transfer, ...]:
        """Take a frame and return the transfers that have ended with it, the older one first.

        Args:
            data: eight bytes.
            now: when [ns].
            is_request: whether the client sent it.
        """
        transfer = self.current
        if transfer is not None and _is_raw_segment(transfer, data, is_request=is_request):
            _take_raw_segment(transfer, data)
            transfer.frames, transfer.end = transfer.frames + 1, now
            return ()
        begun = _begin(data, now) if is_request else None
        if begun is not None:
            self.current, self._has_begun = begun, True
            return () if transfer is None else self._interrupt(transfer, begun)
        waiting = self.overtaken
        if waiting is not None and not is_request and _is_answer_to(waiting, transfer, data):
            self.overtaken, transfer = None, waiting
            _go_on(waiting, data, now, is_request=False)
            return (waiting,)
        if transfer is None:
            return self._end_unseen(data, now, is_request=is_request)
        _go_on(transfer, data, now, is_request=is_request)
        if not transfer.has_ended:
            return ()
        self.current = None
        return (transfer,)

    def _end_unseen(self, data: bytes, now: int, *, is_request: bool) -> tuple[Transfer, ...]:
        """Return the transfer that began before the log, where a frame aborts it."""
        command, index, subindex, code = struct.unpack("<BHBI", data)
        if command != _ABORT or self._has_begun:
            return ()
        self._has_begun = True
        unseen = Transfer(Way.UNSEEN, index, subindex, now, now, abort=code)
        unseen.is_aborted_by_client = is_request
        return (unseen,)

    def expire(self, now: int) -> tuple[Transfer, ...]:
        """Return the transfers that nobody has continued for `PATIENCE`, which ends them."""
        found = self.overtaken, self.current
        late = tuple(each for each in found if each is not None and now - each.end >= PATIENCE)
        self.overtaken, self.current = (None if each in late else each for each in found)
        return late

    def finish(self) -> tuple[Transfer, ...]:
        """Return the transfers that the end of the log interrupts."""
        found = self.overtaken, self.current
        self.overtaken = self.current = None
        return tuple(each for each in found if each is not None)

    def _interrupt(self, transfer: Transfer, begun: Transfer) -> tuple[Transfer, ...]:
        """Return the transfers that end where another begins."""
        is_early = not transfer.is_answered and begun.begin - transfer.begin < AT_ONCE
        if not is_early or transfer.place == begun.place:
            return (transfer,)
        before, self.overtaken = self.overtaken, transfer
        transfer.is_overtaken = True
        return () if before is None else (before,)


def _is_answer_to(waiting: Transfer, current: Transfer | None, data: bytes) -> bool:
    """Return True if an answer names the object of an overtaken request, not of the present one."""
    if data[0] != _ABORT and data[0] >> 5 not in {2, 3}:
        return False
    _, index, subindex = struct.unpack_from("<BHB", data)
    is_current = current is not None and (current.index, current.subindex) == (index, subindex)
    return (waiting.index, waiting.subindex) == (index, subindex) and not is_current


def _go_on(transfer: Transfer, data: bytes, now: int, *, is_request: bool) -> None:
    """Take a frame that continues a transfer."""
    transfer.frames, transfer.end = transfer.frames + 1, now
    transfer.is_answered |= not is_request
    if data[0] == _ABORT:
        transfer.abort = int.from_bytes(data[4:8], "little")
        transfer.is_aborted_by_client = is_request
    elif is_request:
        _hear_request(transfer, data)
    else:
        _hear_answer(transfer, data)


def _begin(data: bytes, now: int) -> Transfer | None:
    """Return the transfer that a request begins, None where it continues one."""
    command, index, subindex = struct.unpack_from("<BHB", data)
    specifier = command >> 5
    if specifier == 2:
        return Transfer(Way.UPLOAD, index, subindex, now, now)
    if specifier == 5 and command & 3 == 0:
        return Transfer(Way.UPLOAD, index, subindex, now, now)
    if specifier == 6 and command & 1 == 0:
        transfer = Transfer(Way.DOWNLOAD, index, subindex, now, now)
        if command & 2:
            transfer.announced = int.from_bytes(data[4:8], "little")
        return transfer
    if specifier == 1:
        transfer = Transfer(Way.DOWNLOAD, index, subindex, now, now)
        _take_initiate(transfer, data)
        return transfer
    return None


def _take_initiate(transfer: Transfer, data: bytes) -> None:
    """Take the data or the length of an initiate request (download) or answer (upload)."""
    command = data[0]
    is_expedited, says_size = command & 2, command & 1
    if is_expedited:
        unused = command >> 2 & 3 if says_size else 0
        transfer.data += data[4 : 8 - unused]
        transfer.is_last = True
    elif says_size:
        transfer.announced = int.from_bytes(data[4:8], "little")


def _take_segment(transfer: Transfer, data: bytes) -> None:
    _keep(transfer, data[1 : 8 - (data[0] >> 1 & 7)])
    transfer.is_last = bool(data[0] & 1)


def _keep(transfer: Transfer, part: bytes) -> None:
    transfer.data += part[: LARGEST - len(transfer.data)]


def _hear_request(transfer: Transfer, data: bytes) -> None:
    specifier = data[0] >> 5
    if transfer.way is Way.DOWNLOAD:
        if specifier == 0:
            _take_segment(transfer, data)
        elif specifier == 6 and data[0] & 1:
            _drop_unused(transfer, data[0] >> 2 & 7)
    elif specifier == 5:
        _hear_block(transfer, data, opens=3)


def _hear_block(transfer: Transfer, data: bytes, *, opens: int) -> None:
    """Take what the receiver of a block transfer says.

    Args:
        transfer: which.
        data: an answer of a download, or a request of an upload.
        opens: the subcommand that opens the first block.
    """
    subcommand = data[0] & 3
    if subcommand == opens:
        transfer.block = []
    elif subcommand == 2:
        _end_block(transfer, data[1])
    elif subcommand == 1:
        transfer.is_done = True


def _hear_answer(transfer: Transfer, data: bytes) -> None:
    specifier = data[0] >> 5
    if transfer.way is Way.DOWNLOAD:
        if specifier in {1, 3}:  # of a segment, of an initiate request
            transfer.is_done = transfer.is_last
        elif specifier == 5:
            _hear_block(transfer, data, opens=0)
    elif specifier == 2:
        _take_initiate(transfer, data)
        transfer.is_done = transfer.is_last
    elif specifier == 0:
        _take_segment(transfer, data)
        transfer.is_done = transfer.is_last
    elif specifier == 6 and data[0] & 1:
        _drop_unused(transfer, data[0] >> 2 & 7)
    elif specifier == 6 and data[0] & 2:
        transfer.announced = int.from_bytes(data[4:8], "little")


def _is_raw_segment(transfer: Transfer, data: bytes, *, is_request: bool) -> bool:
    """Return True if a frame is one of a block, whose first byte is its number."""
    is_senders = is_request is (transfer.way is Way.DOWNLOAD)
    return transfer.block is not None and is_senders and data[0] & 0x7F != 0


def _take_raw_segment(transfer: Transfer, data: bytes) -> None:
    block = transfer.block
    if block is None or data[0] & 0x7F != len(block) + 1:
        return  # one before it was lost; the receiver will ask for it again
    block.append(data[1:8])
    if data[0] & _LAST:
        transfer.is_last = True


def _end_block(transfer: Transfer, acknowledged: int) -> None:
    """Take the segments that have arrived, and open the next block where more are to come."""
    block = transfer.block or []
    if acknowledged < len(block):
        transfer.is_last = False
    _keep(transfer, b"".join(block[:acknowledged]))
    transfer.block = None if transfer.is_last else []


def _drop_unused(transfer: Transfer, unused: int) -> None:
    if unused:
        del transfer.data[-unused:]
