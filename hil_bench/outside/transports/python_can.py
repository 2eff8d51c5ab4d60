"""Any bus that python-can knows, through its `can.BusABC`."""

import logging
from collections.abc import Iterable, Sequence
from dataclasses import replace

import can

from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import BusError, first_line
from hil_bench.frame import bits_of
from hil_bench.outside.messages import frame_of, message_of
from hil_bench.outside.transports.transport import TransportCounters

logger = logging.getLogger(__name__)


class PythonCanTransport:
    """A transport over an open `can.BusABC`.

    Args:
        bus: the bus; the transport shuts it down when it is closed.
        description: the bus in words, for messages.
        has_exact_wait: whether this bus' `recv` keeps its time-out to some 10 us.
        speedup: how many times faster the data phase of CAN FD is; 0 for a classical bus.

    Attributes:
        description: the bus in words.
        has_exact_wait: as passed in.
    """

    def __init__(
        self,
        bus: can.BusABC,
        description: str,
        *,
        has_exact_wait: bool = False,
        speedup: float = 0.0,
    ) -> None:
        self.description = description
        self.has_exact_wait = has_exact_wait
        self._speedup = speedup
        self._has_warned = False
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
            if frame is None or (frame.fd and not self._speedup):
                self._counters.ignored += 1
                self._warn(message)
            else:
                frames.append(frame)
                self._counters.bits += bits_of(frame, self._speedup or 1.0)
        self._counters.received += len(frames)
        return frames

    def _warn(self, message: can.Message) -> None:
        """Say once that frames of CAN FD are ignored."""
        if message.is_fd and not self._has_warned:
            self._has_warned = True
            logger.warning(
                "%s: frames of CAN FD arrive and are ignored; fd = true in bench.toml, or --fd, "
                "makes it a bus of CAN FD",
                self.description,
            )

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
                self._counters.bits += bits_of(frame, self._speedup or 1.0)

    def listen_to(self, can_ids: Iterable[int]) -> None:
        """Leave the filters open: python-can filters most buses in Python, which saves nothing."""

    def counters(self) -> TransportCounters:
        """Return the counters so far; python-can does not report losses in the kernel."""
        return replace(self._counters)

    def close(self) -> None:
        """Shut the bus down; a second call does nothing."""
        self._bus.shutdown()
