"""A hub in a process of its own, and the bench's end of its buses."""

import logging
import os
import secrets
import socket
import time
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import Self

from hil_bench.abilities.common import socketcand_protocol as protocol
from hil_bench.abilities.common.child_process import ChildProcess
from hil_bench.abilities.hub.server import HOST, HubLimits, run_hub
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import BusError
from hil_bench.frame import bits_of
from hil_bench.outside.bits import USUAL_BITRATE
from hil_bench.outside.transports.transport import (
    HUB_PORT,
    TransportCounters,
    has_exact_wait,
    is_readable,
)

# The bench's end of a bus on its own hub.
#
# A hub that has died is to a bench what an interface is that went down: the bench goes on without
# the bus and joins the next hub. Nothing here waits for the hub but `join`.


logger = logging.getLogger(__name__)

MAX_UNSENT = 256 * 1024
"""What may wait for a hub that does not read [byte]; frames beyond it are given up."""

_CHUNK = 65_536
_HANDSHAKE_TIMEOUT = 5.0


class HubTransport:
    """A transport over the socketcand protocol that outlasts its hub.

    Args:
        address: of the hub, host and port.
        channel: of the bus.
        owner: the word that frees us from the hub's limit; empty for none.
        speedup: how many times faster the data phase of CAN FD is than the rest.

    Attributes:
        description: the bus in words.

    Raises:
        BusError: the hub cannot be joined.
    """

    def __init__(
        self, address: tuple[str, int], channel: str, owner: str = "", speedup: float = 1.0
    ) -> None:
        self.description = f"socketcand {channel}"
        self._address = address
        self._words = [f"owner {owner}"] if owner else []
        self._words += [f"open {channel}", "rawmode"]
        self._counters = TransportCounters()
        self._speedup = speedup
        self._is_closed = False
        self._link: _Link | None = None
        self.join()

    @property
    def has_exact_wait(self) -> bool:
        """Return True if `wait` ends on time to some 10 us."""
        link = self._link
        return os.name == "posix" and (link is None or has_exact_wait(link.socket))

    @property
    def is_down(self) -> bool:
        """Return True if the connection to the hub is lost."""
        return self._link is None and not self._is_closed

    def join(self) -> None:
        """Join a hub, in the place of one that is gone; another thread may do it.

        Raises:
            BusError: that is not possible.
        """
        try:
            self._link = _open_link(self._address, self._words)
        except OSError as error:
            host, port = self._address
            raise BusError(f"{self.description}: hub {host}:{port}: {error}") from error

    def drop(self) -> None:
        """Take note that the hub is gone."""
        if self._link is not None:
            self._lose(self._link)

    def receive(self, limit: int) -> list[Frame]:
        """Return at most `limit` frames that have arrived, without waiting."""
        link = self._link
        if link is None:
            return []
        if not link.arrived:
            self._read(link)
        arrived = link.arrived
        frames = [arrived.popleft() for _ in range(min(limit, len(arrived)))]
        self._counters.received += len(frames)
        self._counters.bits += _bits_of(frames, self._speedup)
        return frames

    def wait(self, timeout: float) -> bool:
        """Wait until a frame has arrived, at most `timeout` [s]; return whether one has."""
        link = self._link
        if link is None:
            time.sleep(timeout)
            return False
        if not link.arrived and is_readable(link.socket, timeout):
            self._read(link)
        return bool(link.arrived)

    def send(self, frames: Sequence[Frame]) -> None:
        """Send frames in order; a hub that does not read them in time does not get them.

        Nor does it get remote frames, which the protocol has not.
        """
        link = self._link
        told = [frame for frame in frames if not frame.is_remote]
        if link is None or not link.has_room:
            told = []
        self._counters.send_failures += len(frames) - len(told)
        self._counters.sent += len(told)
        self._counters.bits += _bits_of(told, self._speedup)
        if link is not None:
            try:
                link.write(b"".join(map(protocol.format_send, told)))
            except OSError:
                self._lose(link)
            if not link.has_room and not link.is_late:
                link.is_late = True
                logger.warning(
                    "%s: the hub takes no frames: it hangs, or this machine is too busy; frames "
                    "are lost and counted",
                    self.description,
                )

    def listen_to(self, can_ids: Iterable[int]) -> None:
        """Leave all frames through: a hub has no filters."""

    def counters(self) -> TransportCounters:
        """Return the counters so far."""
        return replace(self._counters, is_down=self.is_down)

    def close(self) -> None:
        """Leave the hub; a second call does nothing."""
        self._is_closed = True
        link, self._link = self._link, None
        if link is not None:
            link.socket.close()

    def _read(self, link: "_Link") -> None:
        try:
            self._counters.ignored += link.read()
        except OSError:
            self._lose(link)

    def _lose(self, link: "_Link") -> None:
        """Go on without the hub; who supervises it says so."""
        link.socket.close()
        if self._link is link:
            self._link = None
            self._counters.outages += 1


class _Link:
    """One connection to a hub.

    Attributes:
        socket: of the connection.
        arrived: frames that nobody has taken yet.
        is_late: whether it was said that the hub does not read.
    """

    def __init__(self, connection: socket.socket) -> None:
        self.socket = connection
        self.arrived: deque[Frame] = deque()
        self.is_late = False
        self._rest = b""
        self._unsent = b""

    @property
    def has_room(self) -> bool:
        """Return True if more may be sent."""
        return len(self._unsent) < MAX_UNSENT

    def shake_hands(self, words: Sequence[str]) -> None:
        """Say these words, each of which the hub must accept; `OSError` where it does not."""
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._expect(b"< hi ")
        for word in words:
            self.socket.sendall(f"< {word} >".encode())
            self._expect(b"< ok ")
        self._take(b"")
        self.socket.setblocking(False)

    def read(self) -> int:
        """Take what has arrived; return how many words of it are no frames.

        Raises:
            ConnectionResetError: the hub is gone.
        """
        try:
            data = self.socket.recv(_CHUNK)
        except BlockingIOError:
            return 0
        if not data:
            raise ConnectionResetError
        return self._take(data)

    def _take(self, data: bytes) -> int:
        """Take the frames of what has arrived; return how many words of it are none.

        Raises:
            ConnectionResetError: this is no hub.
        """
        *texts, self._rest = (self._rest + data).split(b">")
        if len(self._rest) > protocol.MAX_COMMAND:
            raise ConnectionResetError
        frames = [protocol.parse_frame(text.lstrip()) for text in texts]
        self.arrived.extend(frame for frame in frames if frame is not None)
        return frames.count(None)

    def write(self, data: bytes) -> None:
        """Send data behind what waits, as far as the hub takes it; `OSError` where it is gone."""
        unsent = self._unsent + data
        try:
            self._unsent = unsent[self.socket.send(unsent) :] if unsent else b""
        except BlockingIOError:
            self._unsent = unsent

    def _expect(self, answer: bytes) -> None:
        """Read one word of the hub.

        Raises:
            ConnectionResetError: it says none.
            ConnectionRefusedError: it is another one.
        """
        while b">" not in self._rest:
            data = self.socket.recv(256)
            if not data or len(self._rest) > protocol.MAX_COMMAND:
                raise ConnectionResetError("the hub closed the connection")
            self._rest += data
        word, _, self._rest = self._rest.partition(b">")
        if word != answer:
            raise ConnectionRefusedError(ascii(word.decode("ascii", "replace").strip("< "))[1:-1])


def _open_link(address: tuple[str, int], words: Sequence[str]) -> _Link:
    """Return a connection to a hub on which these words have been said.

    Raises:
        OSError: there is none, or it does not accept them.
    """
    connection = socket.create_connection(address, timeout=_HANDSHAKE_TIMEOUT)
    try:
        link = _Link(connection)
        link.shake_hands(words)
    except OSError:
        connection.close()
        raise
    return link


def _bits_of(frames: Sequence[Frame], speedup: float) -> float:
    return sum(bits_of(frame, speedup) for frame in frames)


# The hub in a process of its own, so that its Python does not hold up the loop's.


class HubProcess:
    """A running hub, as a context manager.

    Its use::

        with HubProcess(port=0) as hub:
            can.Bus(interface="socketcand", channel="can0", host=hub.host, port=hub.port)

    It ends with the `with` block, and when its parent process dies; Ctrl-C is left to the parent.

    Args:
        port: 0 takes a free one.
        channels: names that clients may open, one bus each.
        bitrate: that limits what each client sends [bit/s]; None for no limit.
        fd: channels of CAN FD; how many times faster the data phase is on each.

    Attributes:
        host: address it listens on, which keeps the bus on this machine.
        port: port it listens on; the actual one within the `with` block.
    """

    host = HOST

    def __init__(
        self,
        port: int = HUB_PORT,
        channels: Sequence[str] = ("can0",),
        *,
        bitrate: float | None = USUAL_BITRATE,
        fd: Mapping[str, float] | None = None,
    ) -> None:
        self.port = port
        self._channels = tuple(channels)
        self._limits = HubLimits(bitrate, secrets.token_hex(8), fd or {})
        self._child = self._make_child()

    @property
    def alive(self) -> bool:
        """Return True if the process runs."""
        return self._child.alive

    def __enter__(self) -> Self:
        """Start the process and wait until clients may connect; `BusError` where none can."""
        self.port = self._child.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._child.stop()

    def join(self, channel: str) -> HubTransport:
        """Return a bench's end of one of its buses, not limited; `BusError` where there is none."""
        limits = self._limits
        speedup = limits.fd.get(channel, 1.0)
        return HubTransport((self.host, self.port), channel, limits.owner, speedup)

    def ending(self) -> str | None:
        """Describe how the process ended, as in "was killed (SIGKILL)"; None while it runs."""
        return self._child.ending()

    def restart(self) -> None:
        """Start a hub at the same port in the place of one that has ended; `BusError` as before."""
        self._child.stop()
        self._child = self._make_child()
        self._child.start()

    def _make_child(self) -> ChildProcess:
        level = logging.getLogger().getEffectiveLevel()
        return ChildProcess(
            _run,
            (self.port, self._channels, self._limits, level),
            name="hil-bench-hub",
            label=f"hub {self.host}:{self.port}",
        )


def _run(
    port: int,
    channels: Sequence[str],
    limits: HubLimits,
    level: int,
    connection: Connection,
) -> None:
    """Run a hub in this process, which is the child, and report its port or why there is none."""
    logging.basicConfig(level=level, format="hil-bench: %(message)s")
    try:
        run_hub(port, connection.send, channels, limits)
    except (BusError, ValueError) as error:
        connection.send(str(error))
