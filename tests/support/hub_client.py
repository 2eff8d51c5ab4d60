"""A client of socketcand's protocol in the thread of its server, which works while it listens."""

import socket
import time

from support.patience import GUARD


class Client:
    """One connection to a port; `serve` lets the server work for a moment."""

    def __init__(self, port, serve):
        self.socket = socket.create_connection(("127.0.0.1", port))
        self.socket.setblocking(False)
        self._serve = serve
        self._rest = b""

    def say(self, text):
        self.socket.sendall(text)

    def read(self):
        """Return more bytes, none at the end of the connection."""
        deadline = time.monotonic() + GUARD
        while True:
            assert time.monotonic() < deadline
            self._serve()
            try:
                return self.socket.recv(65_536)
            except BlockingIOError:
                continue
            except ConnectionResetError:
                return b""

    def hear(self):
        """Return the next message; None where the server has cut the connection."""
        while b">" not in self._rest:
            data = self.read()
            if not data:
                return None
            self._rest += data
        message, _, self._rest = self._rest.partition(b">")
        return message + b">"

    def join(self, channel=b"can0"):
        assert self.hear() == b"< hi >"
        self.say(b"< open " + channel + b" >")
        assert self.hear() == b"< ok >"
        self.say(b"< rawmode >")
        assert self.hear() == b"< ok >"
        return self

    def close(self):
        self.socket.close()


def receive(transport, count):
    """Return the next frames; pytest-timeout ends it where they do not come."""
    frames = []
    while len(frames) < count:
        transport.wait(0.1)
        frames += transport.receive(count - len(frames))
    return frames
