"""The client's own side of a connection."""

from support.feed_loop import FeedLoop, Wire

from hil_bench.abilities.live.client import FeedClient


class Drip(Wire):
    """A bench that, once greeted, sends a byte a second of a message without an end."""

    def __init__(self, loop):
        super().__init__(loop)
        self.now, self.waits, self.is_dripping = 0.0, [], False

    def settimeout(self, timeout):
        self.waits.append(timeout)

    def recv(self, size):
        if not self.is_dripping:
            return super().recv(size)
        self.now += 1.0
        return b"x"


def test_bytes_that_trickle_in_do_not_prolong_a_wait():
    """3 s are waited for: then 2, then 1, and nothing came."""
    wire = Drip(FeedLoop())
    client = FeedClient("bench", wire, 5.0, clock=lambda: wire.now)
    wire.is_dripping, wire.waits = True, []
    assert client.receive(3.0) is None
    assert wire.waits == [3.0, 2.0, 1.0]
