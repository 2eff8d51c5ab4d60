"""A bus on which nothing happens, for measuring all the rest."""

from collections.abc import Iterable, Sequence

from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.transports.transport import TransportCounters


class SilentTransport:
    """A transport that brings nothing and drops what it is given.

    Attributes:
        description: the bus in words.
        has_exact_wait: never.
    """

    description = "silent"
    has_exact_wait = False

    def receive(self, limit: int) -> list[Frame]:  # noqa: ARG002 - the protocol's
        """Return nothing."""
        return []

    def wait(self, timeout: float) -> bool:  # noqa: ARG002 - the protocol's
        """Return False at once."""
        return False

    def send(self, frames: Sequence[Frame]) -> None:
        """Drop the frames."""

    def listen_to(self, can_ids: Iterable[int]) -> None:
        """Do nothing."""

    def counters(self) -> TransportCounters:
        """Return zeros."""
        return TransportCounters()

    def close(self) -> None:
        """Do nothing."""
