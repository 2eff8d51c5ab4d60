"""A CAN bus between processes where the kernel has none: a hub that speaks the socketcand protocol.

What a client sends goes to every other client of the same channel, in one order for all. The raw
mode of the protocol is spoken as python-can's `socketcand` interface and socketcand itself have it.

A client sends no more than a bus of the hub's bit rate carries. What is beyond that is not read, so
it waits in the client's socket, and in the end the client waits. The hub's owner is not limited; it
says who it is by `< owner TOKEN >` before it opens a channel.

A client has a place once it is in the raw mode, and keeps it however silent. Until then it waits in
a `WaitingRoom`, for a few seconds.
"""

import asyncio
import contextlib
import errno
import logging
import socket
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, cast

from hil_bench.abilities.common import reception
from hil_bench.abilities.common import socketcand_protocol as protocol
from hil_bench.abilities.common.socketcand_protocol import MAX_COMMAND
from hil_bench.errors import BusError
from hil_bench.frame import bits_of, frame_bits
from hil_bench.outside.bits import bitrate_text

HOST = "127.0.0.1"
"""The address of each hub."""

MAX_CLIENTS = 64
"""Most programs on all channels."""

MAX_BACKLOG = 8 * 1024 * 1024
"""What may wait for a client [byte] before it is dropped: tens of seconds of a busy bus."""

logger = logging.getLogger(__name__)

_TOLD_AGAIN = 10_000_000_000
"""Shortest time between two lines on clients that send too much [ns]."""

_BITS_OF_OTHERS = frame_bits(8)
"""What a command that is no frame counts."""

_QUICKACK = getattr(socket, "TCP_QUICKACK", None)


class HubLimits(NamedTuple):
    """The limits on the clients of a hub.

    Attributes:
        bitrate: of each bus [bit/s]; None for no limit.
        owner: the word by which a client is not limited; empty for none.
        fd: channels of CAN FD; how many times faster the data phase is on each.
    """

    bitrate: float | None = None
    owner: str = ""
    fd: Mapping[str, float] = {}


NO_LIMITS = HubLimits()


class Hub:
    """One bus a channel, for clients that connect over TCP.

    Args:
        channels: names that clients may open.
        limits: how much they may send.
        clock: time by which that is limited [ns].

    Attributes:
        limits: as passed in.
        clock: as passed in.
        waiting: clients that are not in the raw mode yet.
    """

    def __init__(
        self,
        channels: Sequence[str] = ("can0",),
        limits: HubLimits = NO_LIMITS,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        for channel in channels:
            protocol.check_channel(channel)
        self.limits = limits
        self.clock = clock
        self._tell_at = 0
        self._buses: dict[str, list[_Client]] = {channel: [] for channel in channels}
        self._seats, room = reception.capacity(MAX_CLIENTS)
        self.waiting: reception.WaitingRoom[_Client] = reception.WaitingRoom(
            _Client.drop, room, clock=lambda: self.clock() * 1e-9
        )

    async def start(self, port: int) -> asyncio.Server:
        """Listen on this machine; port 0 takes a free one.

        Raises:
            BusError: the port cannot be used.
        """
        try:
            return await reception.serve_at(lambda: _Client(self), HOST, port)
        except OSError as error:
            what = f"hub {HOST}:{port}: "
            if error.errno == errno.EADDRINUSE:
                what += "the port is in use, perhaps by another hub; port 0 takes a free one"
            else:
                what += error.strerror or str(error)
            raise BusError(what) from error

    @property
    def is_full(self) -> bool:
        """Return True if no more clients can be in the raw mode."""
        return sum(map(len, self._buses.values())) >= self._seats

    def bus(self, channel: str) -> "list[_Client] | None":
        """Return the clients in raw mode on a channel, None where there is no such channel."""
        return self._buses.get(channel)

    @property
    def channels(self) -> str:
        """The channels' names, for messages."""
        return ", ".join(self._buses)

    def tell_surplus(self, peer: object) -> None:
        """Say now and then that a client has to wait."""
        now, bitrate = self.clock(), self.limits.bitrate
        if now >= self._tell_at and bitrate is not None:
            self._tell_at = now + _TOLD_AGAIN
            logger.warning(
                "hub: the program at %s sends more than a bus of %s carries, and has to wait",
                peer,
                bitrate_text(round(bitrate)),
            )

    def forget(self, client: "_Client") -> None:
        """Remove a client that is gone."""
        self.waiting.leave(client)
        for bus in self._buses.values():
            if client in bus:
                bus.remove(client)


class _Client(asyncio.Protocol):
    """The hub's end of one connection: greeted, then on a channel, then in raw mode."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._rest = b""
        self._bus: list[_Client] | None = None
        self._in_raw_mode = False
        self._speedup = 0.0  # of a classical bus
        self._bad = 0
        self._held_back: list[bytes] | None = None
        self._commands: deque[bytes] = deque()
        self._limit = None if hub.limits.bitrate is None else protocol.RateLimit(hub.limits.bitrate)
        self._transport: asyncio.Transport
        self._socket: socket.socket

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Greet the client; asyncio sets TCP_NODELAY."""
        self._transport = cast("asyncio.Transport", transport)
        self._socket = transport.get_extra_info("socket")
        self._hub.waiting.enter(self)
        self._write(b"< hi >")

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002 - asyncio's signature
        """Leave the bus."""
        self._hub.forget(self)

    def data_received(self, data: bytes) -> None:
        """Carry out the commands that are complete, as far as the bit rate allows."""
        *commands, self._rest = (self._rest + data).split(b">")
        self._commands.extend(commands)
        self._work()
        if self._commands:
            self._transport.pause_reading()
            self._hub.tell_surplus(_address(self._transport.get_extra_info("peername")))
        if len(self._rest) > MAX_COMMAND:
            self.drop()
        elif _QUICKACK is not None:
            # A client with Nagle's algorithm holds the next frame back until this is acknowledged.
            with contextlib.suppress(OSError):  # it has gone meanwhile
                self._socket.setsockopt(socket.IPPROTO_TCP, _QUICKACK, 1)

    def _work(self) -> None:
        """Carry out the commands that wait; those for which it is too soon go on waiting."""
        frames: list[bytes] = []
        commands, limit = self._commands, self._limit
        now, delay = self._hub.clock(), 0.0
        while commands and not delay:
            told = self._obey(commands.popleft().lstrip())
            if told is not None:
                frames.append(told.text)
            if limit is not None:
                limit.take(_BITS_OF_OTHERS if told is None else told.bits, now)
                delay = limit.delay(now)
        if frames:
            self._broadcast(frames)
        if commands:
            asyncio.get_running_loop().call_later(delay * 1e-9, self._go_on)

    def _go_on(self) -> None:
        """Carry out what had to wait, then read on."""
        if self._transport.is_closing():
            return
        self._work()
        if not self._commands:
            self._transport.resume_reading()

    def deliver(self, data: bytes) -> None:
        """Send frames to this client."""
        if self._held_back is not None:
            self._held_back.append(data)
        else:
            self._write(data)

    def _obey(self, command: bytes) -> "_Told | None":
        """Carry out one command, given without its ">"; return the frame that it sends, if any."""
        if self._in_raw_mode:
            self._release()
            frame = _frame_of(command, self._speedup)
            if frame is not None:
                self._bad = 0
            elif not protocol.is_remote_request(command):  # over an error, python-can loses its bus
                is_fd = not self._speedup and protocol.is_fd_command(command)
                self._refuse(protocol.CLASSICAL if is_fd else b"unknown command")
                self._bad += 1
                if self._bad >= protocol.MOST_BAD:
                    self.drop()
            return frame
        match command.split():
            case [b"<", b"owner", word] if word == self._hub.limits.owner.encode():
                self._limit = None
                self._write(b"< ok >")
            case [b"<", b"open" | b"rawmode", *_] if self._hub.is_full:
                self._refuse(b"too many clients")
                self._transport.close()
            case [b"<", b"open", name] if self._bus is None:
                self._open(name)
            case [b"<", b"rawmode"] if self._bus is not None:
                self._enter_raw_mode(self._bus)
            case _:
                self._refuse(b"unknown command")
        return None

    def _open(self, name: bytes) -> None:
        channel = name.decode("ascii", "replace")
        self._bus, self._speedup = self._hub.bus(channel), self._hub.limits.fd.get(channel, 0.0)
        if self._bus is None:
            self._refuse(b"could not open bus; this hub has " + self._hub.channels.encode())
        else:
            self._write(b"< ok >")

    def _enter_raw_mode(self, bus: "list[_Client]") -> None:
        self._in_raw_mode = True
        self._hub.waiting.leave(self)
        self._held_back = []
        self._write(b"< ok >")
        bus.append(self)
        asyncio.get_running_loop().call_later(protocol.JOIN_DELAY, self._release)

    def _release(self) -> None:
        """Deliver what was held back: the client has read the answer to "rawmode"."""
        if self._held_back is None:
            return
        held_back, self._held_back = self._held_back, None
        if held_back:
            self._write(b"".join(held_back))

    def _broadcast(self, frames: list[bytes]) -> None:
        data = b"".join(frames)
        for client in tuple(self._bus or ()):
            if client is not self:
                client.deliver(data)

    def _refuse(self, reason: bytes) -> None:
        self._write(b"< error " + reason + b" >")

    def _write(self, data: bytes) -> None:
        """Send to this client, or cut it off where it does not keep up."""
        if self._transport.is_closing():
            return
        self._transport.write(data)
        if self._transport.get_write_buffer_size() > MAX_BACKLOG:
            self.drop()

    def drop(self) -> None:
        """Cut the connection, whatever is still to be written."""
        self._commands.clear()
        self._hub.forget(self)
        self._transport.abort()


class _Told(NamedTuple):
    """A frame as the others read it, and what it takes on the bus."""

    text: bytes
    bits: float


def _frame_of(command: bytes, speedup: float) -> _Told | None:
    """Return the message of a command that sends to the others; None where it is malformed.

    Args:
        command: without its ">".
        speedup: of the bus; 0 for a classical one.
    """
    frame = protocol.parse_send(command)
    if frame is None or (frame.fd and not speedup):
        return None
    bits = bits_of(frame, speedup or 1.0)
    return _Told(protocol.format_frame(frame, protocol.stamp_of(time.time_ns())), bits)


def _address(peer: object) -> str:
    """Return the address of a connection's other end."""
    return "{}:{}".format(*peer) if isinstance(peer, tuple) else "?"


def run_hub(
    port: int,
    ready: Callable[[int], None],
    channels: Sequence[str] = ("can0",),
    limits: HubLimits = NO_LIMITS,
) -> None:
    """Serve until the process ends or a signal stops it.

    Args:
        port: 0 takes a free one.
        ready: told the port as soon as clients may connect.
        channels: names that clients may open, one bus each.
        limits: how much clients may send.
    """
    asyncio.run(_serve(Hub(channels, limits), port, ready))


async def _serve(hub: Hub, port: int, ready: Callable[[int], None]) -> None:
    reception.say_errors_in_a_line("hub")
    server = await hub.start(port)
    patience = asyncio.create_task(reception.watch_over(hub.waiting))
    ready(server.sockets[0].getsockname()[1])
    try:
        await server.serve_forever()
    finally:
        patience.cancel()
