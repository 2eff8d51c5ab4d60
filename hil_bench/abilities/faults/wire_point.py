"""The point at which faults act on a node whose bus is of copper."""

from collections.abc import Callable
from typing import Protocol

from hil_bench.canopen_device.frame import Frame

Disturbance = Callable[[Frame], float | None]
"""Where in a frame a bit is disturbed, as a share of its bits below 1; None for nowhere."""


class WirePoint(Protocol):
    """The point at which a fault acts on a node on a bus of copper; all times in ns."""

    def disturb(self, rule: Disturbance, *, is_sent: bool) -> None:
        """Have a rule disturb what the node sends, or what it reads."""

    def spare(self, rule: Disturbance, *, is_sent: bool) -> None:
        """Take the rule back."""

    def force_off(self, now: int) -> None:
        """Make the node bus-off."""

    def let_recover(self, now: int) -> None:
        """Let it recover."""

    def stick(self, now: int) -> None:
        """Let it hold the bus dominant."""

    def unstick(self, now: int) -> None:
        """Let it leave the bus."""

    def pull(self, now: int) -> None:
        """Pull its plug: it is alone on its end of the cable."""

    def plug(self, now: int) -> None:
        """Plug it in again."""
