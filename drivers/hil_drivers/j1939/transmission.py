"""Sending by the transport protocol of SAE J1939-21: 9 to 1785 bytes, to one device or to all."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from hil_drivers.errors import DriverError, DriverTimeoutError, TransferAbortedError
from hil_drivers.j1939.identifier import GLOBAL
from hil_drivers.j1939.transport_protocol import (
    BAM_GAP,
    LEAST_BYTES,
    MOST_AT_ONCE,
    MOST_BYTES,
    PACKET_BYTES,
    T3,
    T4,
    AbortReason,
    Control,
    abort,
    connection,
)

GAP: Final = 0.001
"""Time between two packets to one device [s], so that no interface's queue runs over."""

_RETRANSMISSIONS: Final = 2
_REASONS: Final = {int(reason): reason.name.lower().replace("_", " ") for reason in AbortReason}

Put = Callable[[int, bytes], None]
"""Sends eight bytes to an address."""


@dataclass(slots=True, eq=False)
class Transfer:
    """A message on its way to a device, or to all.

    Attributes:
        group: its PGN.
        destination: address of the receiver.
        packets: as frames carry them.
        due: when the next packet goes, or the answer must be there [s].
        size: bytes.
        following: number of the packet that goes next.
        last: number of the last one that may go now.
        reached: the highest that went.
        repeats: how often packets were asked for again.
        is_over: whether it has ended.
        error: why it did not arrive; None where it did, or went to all.
    """

    group: int
    destination: int
    packets: list[bytes]
    due: float
    size: int
    following: int = 1
    last: int = 0
    reached: int = 0
    repeats: int = 0
    is_over: bool = False
    error: DriverError | None = None

    @property
    def is_sending(self) -> bool:
        """Return True if packets may go, and nothing is waited for."""
        return self.following <= self.last

    def __str__(self) -> str:
        to = "to all" if self.destination == GLOBAL else f"to address {self.destination}"
        return f"J1939 PGN {self.group} {to}, {self.size} bytes"


class Transmission:
    """Long messages that we send, one to each device at a time.

    Args:
        control: sends frames of connection management.
        packet: sends packets.
    """

    def __init__(self, control: Put, packet: Put) -> None:
        self._control, self._packet = control, packet
        self._transfers: dict[int, Transfer] = {}

    @property
    def is_busy(self) -> bool:
        """Return True if a message is on its way."""
        return bool(self._transfers)

    def begin(self, group: int, data: bytes, destination: int, now: float) -> Transfer:
        """Announce a message at `now` [s].

        Raises:
            ValueError: it has not 9 to 1785 bytes.
            DriverError: another one is on its way to the same device.
        """
        if not LEAST_BYTES <= len(data) <= MOST_BYTES:
            raise ValueError(f"{len(data)} bytes: {LEAST_BYTES} to {MOST_BYTES} can be sent")
        if destination in self._transfers:
            raise DriverError(f"{self._transfers[destination]}: is on its way still")
        chunks = [data[at : at + PACKET_BYTES] for at in range(0, len(data), PACKET_BYTES)]
        packets = [
            bytes((number,)) + chunk.ljust(PACKET_BYTES, b"\xff")
            for number, chunk in enumerate(chunks, 1)
        ]
        size, count = len(data).to_bytes(2, "little"), len(packets)
        transfer = Transfer(group, destination, packets, now + T3, len(data))
        if destination == GLOBAL:
            transfer.due, transfer.last = now + BAM_GAP, count
            head = connection(Control.BAM, bytes((*size, count, 0xFF)), group)
        else:
            head = connection(Control.RTS, bytes((*size, count, min(count, MOST_AT_ONCE))), group)
        self._control(destination, head)
        self._transfers[destination] = transfer
        return transfer

    def take_control(self, source: int, data: bytes, now: float) -> bool:
        """Take a frame of connection management that is sent to us; False where it is malformed."""
        if len(data) != 8:
            return False
        transfer = self._transfers.get(source)
        if transfer is None or transfer.group != int.from_bytes(data[5:], "little"):
            return True
        if data[0] == Control.CTS:
            self._take_cts(transfer, data[1], data[2], now)
        elif data[0] == Control.END:
            self._take_end(transfer, data[1] | data[2] << 8)
        elif data[0] == Control.ABORT:
            why = f"reason {data[1]} {_REASONS.get(data[1], '')}".rstrip()
            self._end(transfer, TransferAbortedError(f"{transfer}: ended by it, {why}", data[1]))
        return True

    def serve(self, now: float) -> float:
        """Send the packets that are due, and end what is too late; return when to be asked next."""
        for transfer in [each for each in self._transfers.values() if now >= each.due]:
            if transfer.is_sending:
                self._send_packet(transfer, now)
            else:
                what = "answer to the last packet" if transfer.reached else "answer"
                error = DriverTimeoutError(f"{transfer}: no {what} in time")
                self._abort(transfer, AbortReason.TIMEOUT, error)
        return min((each.due for each in self._transfers.values()), default=float("inf"))

    def give_up(self, transfer: Transfer, timeout: float) -> None:
        """End a message that nobody waits for any more; nothing happens where it has ended."""
        if not transfer.is_over:
            error = DriverTimeoutError(f"{transfer}: not within {timeout:g} s")
            self._abort(transfer, AbortReason.TIMEOUT, error)

    def forget(self, why: Callable[[str], DriverError]) -> None:
        """End all messages without a word to the bus; `why` makes the error of each."""
        for transfer in list(self._transfers.values()):
            self._end(transfer, why(str(transfer)))

    def _send_packet(self, transfer: Transfer, now: float) -> None:
        self._packet(transfer.destination, transfer.packets[transfer.following - 1])
        transfer.reached = max(transfer.reached, transfer.following)
        transfer.following += 1
        if transfer.destination == GLOBAL:
            transfer.due = now + BAM_GAP
            if not transfer.is_sending:
                self._end(transfer, None)
        else:
            transfer.due = now + (GAP if transfer.is_sending else T3)

    def _take_cts(self, transfer: Transfer, count: int, first: int, now: float) -> None:
        if transfer.is_sending:
            self._refuse(transfer, AbortReason.CTS_WHILE_SENDING)
        elif not count:
            transfer.due = now + T4
        elif not 0 < first <= min(transfer.reached + 1, len(transfer.packets)):
            self._refuse(transfer, AbortReason.BAD_SEQUENCE)
        elif first <= transfer.reached and transfer.repeats == _RETRANSMISSIONS:
            self._refuse(transfer, AbortReason.RETRANSMISSIONS)
        else:
            transfer.repeats += first <= transfer.reached
            transfer.following, transfer.due = first, now
            transfer.last = min(first + min(count, MOST_AT_ONCE) - 1, len(transfer.packets))

    def _take_end(self, transfer: Transfer, size: int) -> None:
        is_whole = transfer.reached == len(transfer.packets) and not transfer.is_sending
        if is_whole and size == transfer.size:
            self._end(transfer, None)
        else:
            self._refuse(transfer, AbortReason.OTHER)

    def _refuse(self, transfer: Transfer, reason: AbortReason) -> None:
        what = f"{transfer}: ended by us, reason {reason:d} {_REASONS[reason]}"
        self._abort(transfer, reason, TransferAbortedError(what, reason))

    def _abort(self, transfer: Transfer, reason: AbortReason, error: DriverError) -> None:
        self._end(transfer, error)
        if transfer.destination != GLOBAL:
            self._control(transfer.destination, abort(reason, transfer.group))

    def _end(self, transfer: Transfer, error: DriverError | None) -> None:
        transfer.is_over, transfer.error = True, error
        del self._transfers[transfer.destination]
