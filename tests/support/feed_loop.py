"""A bench, the server of its feed and its clients in one thread, without sockets and sleeps.

A client that waits moves the bench on by a tick, and the server hears of it; so a wait ends after a
number of ticks, not after a time.
"""

import json

from hil_bench.abilities.common.shared_ring import SharedRing
from hil_bench.abilities.live.client import FeedClient
from hil_bench.abilities.live.client_link import ClientLink
from hil_bench.abilities.live.server import CAPACITY, MOST_COMMANDS, FeedPlan, FeedServer
from hil_bench.abilities.live.session_feed import LOOK, Feed
from hil_bench.abilities.live.view import hello_of
from hil_bench.abilities.recording.sessions import LiveRecording
from hil_bench.bench.configuration import load_config
from hil_bench.bench.session import open_session

TICK = 1_000_000
PATIENCE = 1000
"""Ticks after which a wait has been in vain."""


class Wire:
    """Both ends of a connection: a socket for the client, a transport for the server.

    Args:
        loop: moves the bench while the client waits.
        room: bytes that the client may leave unread before the server's end is full.
    """

    def __init__(self, loop, room=1 << 40):
        self.loop, self.room, self.high = loop, room, None
        self.out = bytearray()
        self.is_reading, self.is_closed, self.is_full = True, False, False
        self.link = ClientLink(loop.server)
        self.link.connection_made(self)

    def set_write_buffer_limits(self, high):
        self.high = high

    def write(self, data):
        self.out += data
        if len(self.out) > self.room and not self.is_full:
            self.is_full = True
            self.link.pause_writing()

    def is_closing(self):
        return self.is_closed

    def pause_reading(self):
        self.is_reading = False

    def resume_reading(self):
        self.is_reading = True

    def close(self):
        if not self.is_closed:
            self.is_closed = True
            self.link.connection_lost(None)

    abort = close

    def settimeout(self, timeout):
        pass

    def sendall(self, data):
        if self.is_closed:
            raise BrokenPipeError
        self.link.data_received(data)

    def recv(self, size):
        for _ in range(PATIENCE):
            if self.out:
                break
            if self.is_closed:
                return b""
            self.loop.tick()
        else:
            raise TimeoutError
        data = bytes(self.out[:size])
        del self.out[:size]
        if not self.out and self.is_full:
            self.is_full = False
            self.link.resume_writing()
        return data

    def lines(self):
        """Return what the server has sent."""
        data, self.out = bytes(self.out), bytearray()
        if self.is_full:
            self.is_full = False
            self.link.resume_writing()
            data, self.out = data + bytes(self.out), bytearray()
        return [json.loads(line) for line in data.splitlines()]

    def say(self, **message):
        self.link.data_received(json.dumps(message).encode() + b"\n")


class FeedLoop:
    """The bench, its feed and the server; it stands where the process would be."""

    def __init__(self, config=None):
        config = config or load_config()
        self.session = open_session(config)
        self.plan = FeedPlan(
            hello_of("bench", config, self.session),
            1 + len(self.session.channels),
            SharedRing(CAPACITY),
            SharedRing(MOST_COMMANDS),
        )
        self.is_served = True
        self.server = FeedServer(self.plan)
        self.now = -TICK
        self.recording = LiveRecording(self.session, config, is_real_time=False)
        self.feed = Feed(
            self.session, self, self.plan, parts=[self.recording], clock=lambda: self.now
        )
        self.session.start()
        self.tick()

    def look(self):
        return self.is_served

    def stop(self):
        self.is_served = False

    def tick(self, count=1):
        for _ in range(count):
            self.now += TICK
            self.session.tick((), self.now)
            if self.recording._job is not None:
                self.recording._job.join()  # ticks do not outrun the disk here
            self.feed.look()
            self.server.poll()

    def look_again(self):
        """Let the bench look at its nodes and faults."""
        self.tick(LOOK // TICK)

    def connect(self, name=None, timeout=1.0):
        return FeedClient(name or "bench", Wire(self), timeout)
