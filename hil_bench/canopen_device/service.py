"""The interface that a node expects of each of its services."""

from collections.abc import Iterable

from hil_bench.canopen_device.agenda import NEVER
from hil_bench.canopen_device.frame import Emit, Handler
from hil_bench.canopen_device.nmt import NmtState


class Service:
    """One service of a node. What it does not override concerns it not, and has no effect."""

    def handlers(self) -> Iterable[tuple[int | None, Handler]]:
        """Return the handlers of received frames by identifier; None for one that is off."""
        return ()

    def enter(self, state: NmtState) -> None:
        """Follow the NMT state of the node."""

    def reset(self, node_id: int) -> None:
        """Begin anew, for the device `node_id`, after the objects got their power-on values."""

    def serve(self, now: int, emit: Emit) -> int:  # noqa: ARG002 - for those that send
        """Send what is due.

        Returns:
            The next time at which the service has something to do [ns]; it may be earlier than
            need be, never later. NEVER also where an agenda of the service's own has that time.
        """
        return NEVER
