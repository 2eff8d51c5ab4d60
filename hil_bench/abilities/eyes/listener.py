"""Hears every frame of a bus with the time that its driver gives it, and sends nothing."""

import select
import socket
import struct
from collections.abc import Mapping
from typing import Final

import can

from hil_bench.abilities.common.socketcand_bus import CONNECTION
from hil_bench.abilities.common.stamps import SteadyStamps
from hil_bench.abilities.recording.frames import logged_frame_of
from hil_bench.errors import BusError, first_line
from hil_bench.outside.messages import has_bad_length
from hil_bench.outside.recording.channels import LoggedFrame

_SO_MEMINFO: Final = 55
_MEMINFO: Final = struct.Struct("=9I")  # the ninth counts what the kernel dropped


class Listener:
    """The frames of a bus as they come.

    Args:
        bus: open; it stays the caller's.
        description: the bus in words, for messages.

    Attributes:
        description: as passed in.
        frames: data and remote frames so far.
        error_frames: reported by the adapter.
    """

    def __init__(self, bus: can.BusABC, description: str) -> None:
        self.frames = 0
        self.error_frames = 0
        self._bus = bus
        self.description = description
        self._stamps = SteadyStamps()
        self._origin: float | None = None
        self._last = 0

    def hear(self, timeout: float) -> LoggedFrame | None:
        """Return the next frame or error frame, None where none comes in time.

        Its time counts from the first frame, and never runs back.

        Args:
            timeout: longest wait [s].

        Raises:
            BusError: the bus is lost.
        """
        try:
            message = self._bus.recv(timeout)
            if message is None:
                self._check_connection()
                return None
        except (can.CanError, OSError, ValueError) as error:
            raise BusError(f"{self.description}: bus lost: {first_line(error)}") from error
        self._stamps.straighten(message)
        if message.is_error_frame:
            self.error_frames += 1
        elif has_bad_length(message):
            return None
        else:
            self.frames += 1
        if self._origin is None:
            self._origin = message.timestamp
        now = round((message.timestamp - self._origin) * 1e9)
        self._last = max(self._last, now)
        return logged_frame_of(message)._replace(now=self._last, is_received=True)

    def _check_connection(self) -> None:
        """Check that socketcand is still there: python-can takes its end for silence.

        Raises:
            ConnectionResetError: it has closed the connection.
        """
        own = getattr(self._bus, CONNECTION, None)
        if isinstance(own, socket.socket) and is_closed_by_peer(own):
            raise ConnectionResetError("socketcand has closed the connection")

    @property
    def losses(self) -> dict[str, int]:
        """The counts of unreadable or lost frames, by name; the bus is still open."""
        return {
            "error frames": self.error_frames,
            "frames lost by the kernel": self.dropped,
        }

    @property
    def dropped(self) -> int:
        """Frames that the kernel lost because nobody read in time, as far as it says so."""
        own = getattr(self._bus, "socket", None)
        return dropped_by_kernel(own) if isinstance(own, socket.socket) else 0


def loss_words(losses: Mapping[str, int]) -> list[str]:
    """Return losses in words, without those of which there are none."""
    return [f"{count} {name}" for name, count in losses.items() if count]


def is_closed_by_peer(own: socket.socket) -> bool:
    """Return True if the other side of a connection has closed it, and all it sent was read."""
    return bool(select.select([own], [], [], 0.0)[0]) and not own.recv(1, socket.MSG_PEEK)


def dropped_by_kernel(own: socket.socket) -> int:
    """Count the messages that the kernel dropped before this socket; 0 where it does not say."""
    try:
        counts = own.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size)
    except OSError:
        return 0
    return int(_MEMINFO.unpack(counts)[-1]) if len(counts) == _MEMINFO.size else 0
