"""Buses that the bench's own thread hosts, for programs that join over TCP: socketcand's protocol.

A frame reaches the bench without another process in between, and nothing happens but inside the
calls of this transport. That suits a bench that waits for nobody in real time; another is better
served by `hub_process`, which relays frames between clients while the bench is at work.
"""

import errno
import selectors
import socket
import struct
import sys
import time
from collections import deque
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from typing import Final

from hil_bench.abilities.common.reception import QUEUE, WaitingRoom, capacity
from hil_bench.abilities.common.socketcand_protocol import (
    CLASSICAL,
    JOIN_DELAY,
    MAX_COMMAND,
    MOST_BAD,
    check_channel,
    format_frame,
    is_fd_command,
    is_remote_request,
    parse_send,
    stamp_of,
)
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import BusError
from hil_bench.outside.transports.transport import TransportCounters

MAX_CLIENTS: Final = 64
MAX_BACKLOG = 8 * 1024 * 1024
"""What may wait for a client [byte] before it is cut off."""

_CHUNK: Final = 65_536
_STRAIGHT: Final = 15 if sys.platform == "linux" and sys.maxsize > 1 << 32 else 0
"""Waits in a row for the only client, in which nobody else is seen to.

One call receives from it then, in place of one that waits and one that receives."""

_AT_ONCE: Final = socket.MSG_DONTWAIT if _STRAIGHT else 0
_TIMEVAL: Final = struct.Struct("ll")  # of Linux with 64 bits
_QUICKACK: Final = getattr(socket, "TCP_QUICKACK", None)


class HostedBus:
    """A transport that is itself the bus: clients connect to it, and hear the bench and each other.

    Args:
        host: address to listen on; "127.0.0.1" keeps the bus on this machine.
        port: 0 takes a free one.
        channels: the names that clients open, a bus each; a frame has the number of its bus.
        clock: the time that frames are stamped with [ns].
        fd: those of the channels that are of CAN FD.

    Attributes:
        host: as passed in.
        port: the port it listens on.
        description: the bus in words.
        has_exact_wait: no, a wait counts milliseconds.

    Raises:
        BusError: the address cannot be had.
    """

    has_exact_wait = False

    def __init__(
        self,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        channels: Sequence[str] = ("can0",),
        clock: Callable[[], int] = time.time_ns,
        fd: Collection[str] = (),
    ) -> None:
        for channel in channels:
            check_channel(channel)
        self._channels = [channel.encode() for channel in channels]
        self._clock = clock
        self._fd = [channel in fd for channel in channels]
        self._arrived: deque[Frame] = deque()
        self._clients: list[_Client] = []
        self._seats, room = capacity(MAX_CLIENTS)
        self._waiting: WaitingRoom[_Client] = WaitingRoom(self._forget, room)
        self._counters = TransportCounters()
        self._straight = 0
        self._selector = selectors.DefaultSelector()
        try:
            self._server = socket.create_server((host, port), backlog=QUEUE)
        except OSError as error:
            self._selector.close()
            what = error.strerror or str(error)
            if error.errno == errno.EADDRINUSE:
                what = "the port is in use, perhaps by another hub; port 0 takes a free one"
            raise BusError(f"hub {host}:{port}: {what}") from error
        self._server.setblocking(False)
        self._selector.register(self._server, selectors.EVENT_READ, self._admit)
        self.host, self.port = host, self._server.getsockname()[1]
        self.description = f"hub {host}:{self.port} {' '.join(channels)}"

    @property
    def clients(self) -> int:
        """Return the number of programs on the bus."""
        return sum(client.is_on_bus for client in self._clients)

    def receive(self, limit: int) -> list[Frame]:
        """Return at most `limit` frames that have arrived, without waiting."""
        arrived = self._arrived
        if not arrived:
            self._serve(0.0)
        frames = [arrived.popleft() for _ in range(min(limit, len(arrived)))]
        self._counters.received += len(frames)
        return frames

    def wait(self, timeout: float) -> bool:
        """Wait until a frame has arrived, at most `timeout` [s]; return whether one has.

        A client that connects, or says anything else, ends the wait early.
        """
        if not self._arrived:
            self._serve(timeout)
        return bool(self._arrived)

    def send(self, frames: Sequence[Frame]) -> None:
        """Send frames in order to all clients; the protocol has no remote frames."""
        told = [frame for frame in frames if not frame.is_remote]
        self._counters.sent += len(told)
        self._counters.send_failures += len(frames) - len(told)
        self._tell(told, None)

    def listen_to(self, can_ids: Iterable[int]) -> None:
        """Leave all frames through: the clients hear each other anyway."""

    def counters(self) -> TransportCounters:
        """Return the counters so far."""
        return replace(self._counters)

    def close(self) -> None:
        """Cut all clients off and stop listening; a second call does nothing."""
        for client in tuple(self._clients):
            client.close()
        self._clients.clear()
        self._server.close()
        self._selector.close()

    def _serve(self, timeout: float) -> None:
        """Do what clients ask for, waiting at most `timeout` [s] until one asks anything."""
        if self._waiting:
            self._waiting.look()
        for client in self._clients:
            client.acknowledge()
            if client.is_behind:
                client.flush()
        if timeout > 0.0 and self._straight and len(self._clients) == 1:
            client = self._clients[0]
            if client.is_on_bus:
                self._straight = self._straight - 1 if self._hear(client, timeout) else 0
                return
        for key, _ in self._selector.select(timeout):
            key.data()
        self._straight = _STRAIGHT

    def _admit(self) -> None:
        """Take a client that connects, if there is room for it."""
        try:
            connection, _ = self._server.accept()
        except OSError as error:  # it has gone again, or there are too many files
            if error.errno in {errno.EMFILE, errno.ENFILE} and len(self._waiting):
                self._waiting.dismiss_oldest()
            return
        client = _Client(connection, self._channels, self._fd)
        self._waiting.enter(client)
        self._clients.append(client)
        self._selector.register(connection, selectors.EVENT_READ, lambda: self._hear(client))

    def _hear(self, client: "_Client", timeout: float = 0.0) -> bool:
        """Take what a client says: its frames go to the bench and to the other clients.

        Returns:
            Whether it has sent frames within `timeout` [s].
        """
        was_on_bus = client.is_on_bus
        is_full = not was_on_bus and self.clients >= self._seats
        frames = client.read(is_full=is_full, timeout=timeout)
        if client.is_on_bus and not was_on_bus:
            self._waiting.leave(client)
        self._arrived.extend(frames)
        if len(self._clients) > 1:
            self._tell(frames, client)
        if client.is_closed:
            self._forget(client)
        return bool(frames)

    def _tell(self, frames: Sequence[Frame], source: "_Client | None") -> None:
        """Tell frames to all clients on their bus but the one that they come from."""
        others = [other for other in self._clients if other.is_on_bus and other is not source]
        if not frames or not others:
            return
        stamp = stamp_of(self._clock())
        texts = [b""] * len(self._channels)
        for frame in frames:
            texts[frame.bus] += format_frame(frame, stamp)
        for other in others:
            other.tell(texts[other.bus])
            if other.is_closed:
                self._forget(other)

    def _forget(self, client: "_Client") -> None:
        """Let go of a client that is gone, once."""
        if client not in self._clients:
            return
        self._waiting.leave(client)
        self._selector.unregister(client.socket)
        self._clients.remove(client)
        client.close()


class _Client:
    """One connection: greeted, then on a channel, then in raw mode, which is on the bus."""

    def __init__(
        self, connection: socket.socket, channels: Sequence[bytes], fd: Sequence[bool]
    ) -> None:
        self.socket = connection
        self.is_on_bus = False
        self.is_closed = False
        self.bus = 0
        self._channels = channels
        self._fd = fd
        self._has_opened = self._is_full = self._owes = False
        self._rest = b""
        self._bad = 0
        self._unsent = b""
        self._held_until: float | None = None
        self._timeout = 0.0
        connection.setblocking(_STRAIGHT > 0)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._write(b"< hi >")

    @property
    def is_behind(self) -> bool:
        """Return True if something waits to be sent to it."""
        return bool(self._unsent)

    def read(self, *, is_full: bool, timeout: float) -> list[Frame]:
        """Return the frames that it sends, and answer what else it says.

        Args:
            is_full: whether no more clients can be on the bus.
            timeout: longest wait until it says anything [s].
        """
        self._is_full = is_full
        try:
            if timeout == 0.0:
                data = self.socket.recv(_CHUNK, _AT_ONCE)
            else:
                self._limit_waits(timeout)
                data = self.socket.recv(_CHUNK)
        except BlockingIOError:
            return []
        except OSError:
            data = b""
        if not data:
            self.is_closed = True
            return []
        *commands, self._rest = (self._rest + data).split(b">")
        if len(self._rest) > MAX_COMMAND:
            self.is_closed = True
        self._owes = True
        frames = [frame for text in commands if (frame := self._obey(text.lstrip())) is not None]
        return [frame._replace(bus=self.bus) for frame in frames] if self.bus else frames

    def acknowledge(self) -> None:
        """Acknowledge what was read, unless an answer has done so.

        A client with Nagle's algorithm holds the next frame back until then.
        """
        if self._owes and _QUICKACK is not None and not self.is_closed:
            self.socket.setsockopt(socket.IPPROTO_TCP, _QUICKACK, 1)
        self._owes = False

    def tell(self, text: bytes) -> None:
        """Send it frames, or keep them while it is to read the answer to "rawmode" alone."""
        if self._held_until is None:
            self._write(text)
        else:
            self._unsent += text
            self.flush()

    def flush(self) -> None:
        """Send what waits, as far as it may and can be sent."""
        if self._held_until is None or time.monotonic() >= self._held_until:
            self._held_until = None
            self._write(b"")

    def close(self) -> None:
        """End the connection."""
        self.is_closed = True
        self.is_on_bus = False
        self.socket.close()

    def _obey(self, command: bytes) -> Frame | None:
        """Carry out a command, given without its ">"; return the frame that it sends, if any."""
        if self.is_on_bus:
            self._release()
            is_wrong = is_fd_command(command) and not self._fd[self.bus]
            frame = None if is_wrong else parse_send(command)
            if frame is not None:
                self._bad = 0
            elif not is_remote_request(command):  # python-can takes an error for a loss
                self._write(b"< error %b >" % (CLASSICAL if is_wrong else b"unknown command"))
                self._bad += 1
                self.is_closed |= self._bad >= MOST_BAD
            return frame
        match command.split():
            case [b"<", b"open" | b"rawmode", *_] if self._is_full:
                self._write(b"< error too many clients >")
                self.is_closed = True
            case [b"<", b"open", name] if not self._has_opened:
                self._open(name)
            case [b"<", b"rawmode"] if self._has_opened:
                self._write(b"< ok >")
                self.is_on_bus = True
                self._held_until = time.monotonic() + JOIN_DELAY
            case _:
                self._write(b"< error unknown command >")
        return None

    def _release(self) -> None:
        """Send what was held back: the client has read the answer to "rawmode"."""
        if self._held_until is not None:
            self._held_until = None
            self._write(b"")

    def _open(self, name: bytes) -> None:
        self._has_opened = name in self._channels
        if self._has_opened:
            self.bus = self._channels.index(name)
        refusal = b"< error could not open bus; this hub has " + b", ".join(self._channels) + b" >"
        self._write(b"< ok >" if self._has_opened else refusal)

    def _limit_waits(self, timeout: float) -> None:
        """Let no call wait for longer than `timeout` [s]."""
        if timeout != self._timeout:
            self._timeout = timeout
            seconds, microseconds = divmod(max(round(timeout * 1e6), 1), 1_000_000)
            limit = _TIMEVAL.pack(seconds, microseconds)
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, limit)

    def _write(self, text: bytes) -> None:
        """Send text behind what still waits; a client that does not keep up is to be cut off."""
        unsent = self._unsent + text
        try:
            if unsent:
                unsent = unsent[self.socket.send(unsent, _AT_ONCE) :]
                self._owes = False
        except BlockingIOError:
            pass
        except OSError:
            self.is_closed = True
        self._unsent = unsent
        self.is_closed |= len(unsent) > MAX_BACKLOG
