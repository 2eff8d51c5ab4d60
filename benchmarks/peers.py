"""The libraries that are compared with, without a bus: what their nodes send goes to a list."""

from collections.abc import Callable

import canopen

from hil_bench.canopen_device.frame import Frame

try:
    from durand.network import NetworkABC
except ImportError:  # of the extra `benchmark`
    NetworkABC = object

Sent = list[tuple[int, bytes]]
"""Identifier and data of each frame."""


class CanopenNetwork(canopen.Network):
    """A network of `canopen`.

    Attributes:
        sent: what its nodes sent.
    """

    def __init__(self) -> None:
        super().__init__()
        self.sent: Sent = []

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:  # noqa: ARG002
        """Keep the frame."""
        self.sent.append((can_id, data))

    def exchange(self, frame: Frame) -> Sent:
        """Return the answers to a frame."""
        self.sent = []
        self.notify(frame.can_id, bytearray(frame.data), 0.0)
        return self.sent


class DurandNetwork(NetworkABC):
    """A network of `durand`.

    Attributes:
        sent: what its nodes sent.
    """

    def __init__(self) -> None:
        self.sent: Sent = []
        self._callbacks: dict[int, Callable[[int, bytes], None]] = {}

    def notify(self, can_id: int, data: bytes) -> None:
        """Give its nodes a frame."""
        callback = self._callbacks.get(can_id)
        if callback is not None:
            callback(can_id, data)

    def add_subscription(  # noqa: D102 - told by the base class
        self, cob_id: int, callback: Callable[[int, bytes], None]
    ) -> None:
        self._callbacks[cob_id] = callback

    def remove_subscription(self, cob_id: int, _callback: object = None) -> None:  # noqa: D102
        self._callbacks.pop(cob_id, None)

    def send(self, cob_id: int, msg: bytes) -> None:  # noqa: D102
        self.sent.append((cob_id, msg))
