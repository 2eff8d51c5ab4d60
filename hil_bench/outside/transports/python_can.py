"""Any bus that python-can knows, through its `can.BusABC`."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import can

from hil_bench.canopen_device.frame import Frame, make_frame
from hil_bench.errors import BusError, first_line
from hil_bench.frame import frame_bits
from hil_bench.outside.transports.transport import TransportCounters

_STANDARD_ID_MAX = 0x7FF
_EXTENDED_ID_MAX = 0x1FFF_FFFF
_DATA_MAX = 8


def frame_of(message: can.Message) -> Frame | None:
    """Return the message as a `Frame`, or None where it is no classical data or remote frame."""
    if message.is_error_frame or message.is_fd or len(message.data) > _DATA_MAX:
        return None
    limit = _EXTENDED_ID_MAX if message.is_extended_id else _STANDARD_ID_MAX
    if not 0 <= message.arbitration_id <= limit:
        return None
    data = b"" if message.is_remote_frame else bytes(message.data)
    return make_frame(
        Frame, (message.arbitration_id, data, message.is_remote_frame, message.is_extended_id, 0)
    )


def message_of(frame: Frame) -> can.Message:
    """Return the frame as python-can's message."""
    return can.Message(
        arbitration_id=frame.can_id,
        data=frame.data,
        is_remote_frame=frame.is_remote,
        is_extended_id=frame.is_extended,
    )


class PythonCanTransport:
    """A transport over an open `can.BusABC`.

    Args:
        bus: the bus; the transport shuts it down when it is closed.
        description: the bus in words, for messages.
        has_exact_wait: whether this bus' `recv` keeps its time-out to some 10 us.

    Attributes:
        description: the bus in words.
        has_exact_wait: as passed in.
    """

    def __init__(self, bus: can.BusABC, description: str, *, has_exact_wait: bool = False) -> None:
        self.description = description
        self.has_exact_wait = has_exact_wait
        self._bus = bus
        self._waiting: can.Message | None = None
        self._counters = TransportCounters()

    def receive(self, limit: int) -> list[Frame]:
        """Return the frames in at most `limit` messages that have arrived, without waiting."""
        frames: list[Frame] = []
        for _ in range(limit):
            message, self._waiting = self._waiting or self._read(0), None
            if message is None:
                break
            frame = frame_of(message)
            if frame is None:
                self._counters.ignored += 1
            else:
                frames.append(frame)
                self._counters.bits += frame_bits(len(frame.data), is_extended=frame.is_extended)
        self._counters.received += len(frames)
        return frames

    def wait(self, timeout: float) -> bool:
        """Wait until a message has arrived, at most `timeout` [s]; return whether one has."""
        self._waiting = self._waiting or self._read(timeout)
        return self._waiting is not None

    def _read(self, timeout: float) -> can.Message | None:
        """Return the next message, None where none comes in time [s].

        Not by `recv`, which looks at the system's clock between two messages: where that was set
        back by an hour, it would wait for an hour.

        Raises:
            BusError: the bus is lost.
        """
        try:
            message, is_filtered = self._bus._recv_internal(timeout)  # noqa: SLF001 - see above
            is_wanted = is_filtered or message is None or self._bus._matches_filters(message)  # noqa: SLF001
        except (can.CanError, OSError, ValueError) as error:
            raise BusError(f"{self.description}: bus lost: {first_line(error)}") from error
        return message if is_wanted else None

    def send(self, frames: Sequence[Frame]) -> None:
        """Send frames in order; one that python-can refuses is counted as failed.

        Raises:
            BusError: the bus is lost.
        """
        for frame in frames:
            try:
                self._bus.send(message_of(frame))
            except can.CanOperationError:
                self._counters.send_failures += 1
            except (can.CanError, OSError, ValueError) as error:
                raise BusError(f"{self.description}: bus lost: {first_line(error)}") from error
            else:
                self._counters.sent += 1
                self._counters.bits += frame_bits(len(frame.data), is_extended=frame.is_extended)

    def listen_to(self, can_ids: Iterable[int]) -> None:
        """Leave the filters open: python-can filters most buses in Python, which saves nothing."""

    def counters(self) -> TransportCounters:
        """Return the counters so far; python-can does not report losses in the kernel."""
        return replace(self._counters)

    def close(self) -> None:
        """Shut the bus down; a second call does nothing."""
        self._bus.shutdown()
