"""An event loop and a TCP network in virtual time: one seed, one course of events.

Servers and clients run as they are, on asyncio's own transports' rules: what is written is cut into
segments of random lengths that arrive after random times, a receiver that does not read holds its
sender up, connections end in order, half-closed, or by a reset. Nothing waits for a real clock, so
a second takes as long as what happens in it.
"""

import asyncio
import contextlib
import itertools
import random
import selectors
from typing import NamedTuple

WINDOW = 4096
"""Bytes that are on their way in one direction, or received and not yet read."""


class Pace(NamedTuple):
    """How a direction of a connection cuts and delays: longest segment [byte] and delay [s]."""

    segment: int
    delay: float


PACES = (Pace(65536, 0.0002), Pace(40, 0.001), Pace(7, 0.0003), Pace(1, 0.00005), Pace(300, 0.01))


class _Jump(selectors.SelectSelector):
    """Waits for nothing: time jumps to the next thing that is due."""

    def __init__(self):
        super().__init__()
        self.now = 0.0

    def select(self, timeout=None):
        if timeout is None:
            raise RuntimeError("nothing is due any more, and somebody waits")
        self.now += max(timeout, 0.0)
        return []


class VirtualLoop(asyncio.SelectorEventLoop):
    """The loop, its network, and the errors that nobody handled.

    Args:
        seed: of all that is random.
    """

    def __init__(self, seed):
        self._jump = _Jump()
        super().__init__(self._jump)
        self.dice = random.Random(seed)  # noqa: S311 - not for secrets
        self.errors = []
        self.ends = []  # of servers
        self._clients = []
        self._listeners = {}
        self._numbers = itertools.count(1)

    def time(self):
        return self._jump.now

    @property
    def is_delivering(self):
        """True while bytes are on their way to somebody who reads."""
        return any(end.is_delivering for end in (*self.ends, *self._clients))

    def call_exception_handler(self, context):
        self.errors.append(f"{context['message']}: {context.get('exception')!r}")

    async def create_server(self, protocol_factory, _host=None, port=None, **_options):
        if port in self._listeners:
            raise OSError(98, "Address already in use")
        self._listeners[port] = protocol_factory
        return _Listener(port)

    async def create_connection(self, protocol_factory, _host=None, port=None, **_options):
        await asyncio.sleep(self.dice.uniform(0.0, 0.001))
        if port not in self._listeners:
            raise ConnectionRefusedError(111, "Connection refused")
        number = next(self._numbers)
        server = End(self, self._listeners[port](), ("10.0.0.1", number), port)
        client = End(self, protocol_factory(), ("127.0.0.1", port), None)
        server.peer, client.peer = client, server
        self.ends.append(server)
        self._clients.append(client)
        for end in (server, client):
            self.call_soon(end.begin)
        await asyncio.sleep(0)
        return client, client.get_protocol()

    async def connect(self, port, limit=1 << 16):
        """Return a reader and a writer."""
        reader = asyncio.StreamReader(limit, loop=self)
        protocol = asyncio.StreamReaderProtocol(reader, loop=self)
        transport, _ = await self.create_connection(lambda: protocol, "127.0.0.1", port)
        return reader, _Writer(transport, protocol, reader, self)

    def close(self):
        for end in (*self.ends, *self._clients):
            end.vanish()
        super().close()

    def kill(self, port):
        """Have the process behind a port die: it closes nothing in order."""
        del self._listeners[port]
        for end in self.ends:
            if end.port == port:
                end.vanish()


class _Writer(asyncio.StreamWriter):
    """One that may be forgotten, as a process that dies forgets its connections."""

    def __del__(self):
        pass


class _Listener:
    def __init__(self, port):
        self.sockets = [self]
        self._port = port

    def getsockname(self):
        return "127.0.0.1", self._port

    def dup(self):
        return contextlib.nullcontext(self)

    def listen(self, _backlog):
        """Take every connection at once, as this loop does."""

    async def serve_forever(self):
        await asyncio.Event().wait()


class _Socket:
    """What a protocol may ask of its socket."""

    def __init__(self, end):
        self._end = end

    def setsockopt(self, *_):
        if self._end.peer.is_gone:
            raise OSError(22, "Invalid argument")


class End(asyncio.Transport):
    """One end of a connection, with the buffers of its process and of its kernel."""

    def __init__(self, loop, protocol, peername, port):
        super().__init__({"peername": peername, "socket": _Socket(self)})
        self.port = port
        self.peer = None
        self.is_gone = False  # its socket is closed
        self._loop = loop
        self._protocol = protocol
        self._pace = loop.dice.choice(PACES)
        self._unsent = bytearray()  # in the process
        self._arriving = bytearray()  # on the wire, and received but not read
        self._high = 64 * 1024
        self._is_choked = self._is_paused = self._is_closing = False
        self._wants_eof = self._has_eof = self._knows_eof = False
        self._delivery = None

    def begin(self):
        self._call(self._protocol.connection_made, self)
        self._expect()

    @property
    def is_delivering(self):
        return self._delivery is not None and not self.is_gone

    # What asyncio's transports have.

    def get_protocol(self):
        return self._protocol

    def set_protocol(self, protocol):
        self._protocol = protocol

    def is_closing(self):
        return self._is_closing

    def is_reading(self):
        return not (self._is_paused or self._is_closing)

    def pause_reading(self):
        self._is_paused = True

    def resume_reading(self):
        self._is_paused = False
        self._expect()

    def set_write_buffer_limits(self, high=None, low=None):  # noqa: ARG002 - asyncio's
        self._high = high

    def get_write_buffer_size(self):
        return len(self._unsent)

    def can_write_eof(self):
        return True

    def write(self, data):
        if self._is_closing:
            return
        self._unsent += data
        self._send()
        if len(self._unsent) > self._high and not self._is_choked:
            self._is_choked = True
            self._call(self._protocol.pause_writing)

    def write_eof(self):
        self._wants_eof = True
        self._send()

    def close(self):
        if not self._is_closing:
            self._is_closing = True
            if not self._unsent:
                self._loop.call_soon(self._lose, None)

    def abort(self):
        self._force(None)

    # What happens on the wire.

    def reset(self):
        """Close at once, by a reset."""
        self._arriving += b"?"  # a socket that is closed with bytes unread sends a reset
        self.abort()

    def vanish(self):
        """Close as a process does that is killed: its protocol hears nothing."""
        if not self.is_gone:
            self._is_closing = self.is_gone = True
            self._loop.call_soon(self.peer.hear_reset)

    def hear_reset(self):
        if not self.is_gone:
            self._arriving.clear()
            self._force(ConnectionResetError(104, "Connection reset by peer"))

    def _force(self, error):
        if not self.is_gone:
            self._is_closing = True
            self._unsent.clear()
            self._loop.call_soon(self._lose, error)

    def _lose(self, error):
        if self.is_gone:
            return
        self.is_gone = True
        self._call(self._protocol.connection_lost, error)
        peer = self.peer
        if peer.is_gone:
            return
        if self._arriving:
            self._loop.call_later(self._pace.delay, peer.hear_reset)
        else:
            peer._has_eof = True
            peer._expect()
            peer._send()

    def _send(self):
        """Pass on what there is room for."""
        if self.peer.is_gone:
            if self._unsent:
                self._loop.call_later(self._pace.delay, self.hear_reset)
            return
        room = max(0, WINDOW - len(self.peer._arriving))
        self.peer._arriving += self._unsent[:room]
        del self._unsent[:room]
        if not self._unsent:
            if self._wants_eof:
                self.peer._has_eof = True
            if self._is_closing:
                self._loop.call_soon(self._lose, None)
        self.peer._expect()
        if self._is_choked and len(self._unsent) <= self._high // 4:
            self._is_choked = False
            self._call(self._protocol.resume_writing)

    def _expect(self):
        """See to it that what has arrived is read, some time."""
        is_due = self._arriving or (self._has_eof and not self._knows_eof)
        if self._delivery is None and is_due and self.is_reading():
            delay = self._loop.dice.uniform(0.0, self._pace.delay)
            self._delivery = self._loop.call_later(delay, self._deliver)

    def _deliver(self):
        self._delivery = None
        if not self.is_reading():
            return
        if self._arriving:
            size = self._loop.dice.randint(1, self._pace.segment)
            self._hand_over(size)
            self.peer._send()
        elif self._has_eof and not self._knows_eof:
            self._knows_eof = True
            if not self._call(self._protocol.eof_received):
                self.close()
        self._expect()

    def _hand_over(self, size):
        if isinstance(self._protocol, asyncio.BufferedProtocol):
            buffer = self._protocol.get_buffer(-1)
            data = self._arriving[: min(size, len(buffer))]
            buffer[: len(data)] = data
            del self._arriving[: len(data)]
            self._call(self._protocol.buffer_updated, len(data))
        else:
            data = bytes(self._arriving[:size])
            del self._arriving[: len(data)]
            self._call(self._protocol.data_received, data)

    def _call(self, act, *arguments):
        """Call the protocol; what it raises is fatal to the connection, and an error of the run."""
        try:
            return act(*arguments)
        except Exception as error:
            self._loop.call_exception_handler({"message": act.__name__, "exception": error})
            self._force(error)
            return False
