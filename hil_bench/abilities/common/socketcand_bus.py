"""python-can's bus on a socketcand, with frames of CAN FD, which python-can 4.6 has not."""

import select
from collections import deque
from typing import TYPE_CHECKING, Any, Final

import can
from can.interfaces.socketcand.socketcand import (
    SocketCanDaemonBus,
    convert_ascii_message_to_can_message,
)

from hil_bench.abilities.common.socketcand_protocol import (
    MAX_COMMAND,
    format_send,
    is_fd_frame,
    parse_frame,
)
from hil_bench.outside.messages import frame_of, message_of

if TYPE_CHECKING:
    import socket

CONNECTION: Final = "_SocketCanDaemonBus__socket"
"""Name of the connection; python-can gives no other way to it."""

_CHUNK = 65_536


class SocketcandFdBus(SocketCanDaemonBus):
    """A channel of a socketcand; the arguments are python-can's.

    The protocol has no remote frames; python-can would send data frames with their identifiers.

    Attributes:
        carries_remote: whether remote frames can be sent.
    """

    carries_remote = False

    def __init__(self, *, fd: bool = True, **settings: Any) -> None:  # noqa: ANN401, ARG002 - python-can's
        self._arrived: deque[can.Message] = deque()
        self._rest = b""
        super().__init__(**settings)  # type: ignore[no-untyped-call]  # python-can's
        self._can_protocol = can.CanProtocol.CAN_FD

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a message, unless it is a remote frame.

        Raises:
            can.CanOperationError: it is one of CAN FD, and of a length that no DLC has.
        """
        if msg.is_remote_frame:
            return
        if not msg.is_fd:
            super().send(msg, timeout)  # type: ignore[no-untyped-call]  # python-can's
            return
        frame = frame_of(msg)
        if frame is None:
            raise can.CanOperationError(f"no frame of CAN FD: {msg}")
        self._tcp_send(format_send(frame).decode("ascii"))

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._arrived:
            self._read(timeout)
        return (self._arrived.popleft() if self._arrived else None), False

    def _read(self, timeout: float | None) -> None:
        """Take what comes in time [s].

        Raises:
            can.CanError: the connection is lost, or nobody of socketcand speaks there.
        """
        own: socket.socket = getattr(self, CONNECTION)
        try:
            if not select.select([own], [], [], timeout)[0]:
                return
            *texts, self._rest = (self._rest + own.recv(_CHUNK)).split(b">")
        except OSError as error:
            raise can.CanError(f"Failed to receive: {error}") from error
        if len(self._rest) > MAX_COMMAND:
            raise can.CanError("Failed to receive: no end of a message in sight")
        for text in texts:
            message = _message_of(text.lstrip())
            if message is not None:
                message.channel = self.channel
                self._arrived.append(message)


def _message_of(text: bytes) -> can.Message | None:
    """Return the message in a word of socketcand, given without its ">"; None for no frame."""
    if not is_fd_frame(text):
        message: can.Message | None = convert_ascii_message_to_can_message(
            text.decode("ascii", "replace") + ">"
        )
        return message
    frame = parse_frame(text)
    if frame is None:
        return None
    message = message_of(frame)
    message.timestamp = float(text.split()[4])
    return message
