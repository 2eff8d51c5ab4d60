"""The transport protocol of SAE J1939-21: 9 to 1785 bytes, to one (RTS/CTS) or to all (BAM).

What breaks the rules ends its session, with an abort where it has one partner.
"""

from hil_bench.abilities.j1939.protocol.identifier import GLOBAL, NULL
from hil_bench.abilities.j1939.protocol.reception import Deliver, Reception
from hil_bench.abilities.j1939.protocol.transmission import Transmission
from hil_bench.abilities.j1939.protocol.transport_protocol import (
    Control,
    Line,
    Put,
    TransportCounters,
)


class Transport:
    """The sessions of one device.

    Args:
        put_control: sends TP.CM.
        put_data: sends TP.DT.
        deliver: takes the messages that have come.
    """

    def __init__(self, put_control: Put, put_data: Put, deliver: Deliver) -> None:
        self._line = Line(put_control)
        self._reception = Reception(self._line, deliver)
        self._transmission = Transmission(self._line, put_data)

    @property
    def counters(self) -> TransportCounters:
        """The counters so far."""
        return self._line.counters

    @property
    def due(self) -> int:
        """When `serve` has something to do [ns]; it may be earlier than need be."""
        return min(self._reception.due, self._transmission.due)

    def reset(self) -> None:
        """Forget all sessions."""
        self._reception.reset()
        self._transmission.reset()

    def send(self, group: int, data: bytes, destination: int, now: int) -> bool:
        """Send a message of 9 to 1785 bytes; False where it has no room to wait in."""
        return self._transmission.send(group, data, destination, now)

    def take_control(self, source: int, destination: int, data: bytes, now: int) -> None:
        """Take a TP.CM message."""
        if len(data) != 8 or source >= NULL:
            self._line.counters.ignored += 1
            return
        group = int.from_bytes(data[5:8], "little")
        control = data[0]
        if destination == GLOBAL:
            if control == Control.BAM:
                self._reception.take_bam(source, group, data, now)
            else:
                self._line.counters.ignored += 1
        elif control == Control.RTS:
            self._reception.take_rts(source, group, data, now)
        elif control == Control.CTS:
            self._transmission.take_cts(source, group, data, now)
        elif control == Control.END:
            self._transmission.take_end(source, group, data, now)
        elif control == Control.ABORT:
            self._take_abort(source, group, data[1], now)
        else:
            self._line.counters.ignored += 1

    def take_data(self, source: int, destination: int, data: bytes, now: int) -> None:
        """Take a TP.DT message."""
        self._reception.take_data(source, destination, data, now)

    def serve(self, now: int) -> None:
        """End the sessions whose time is over, and send packets to all that are due."""
        self._reception.serve(now)
        self._transmission.serve(now)

    def _take_abort(self, source: int, group: int, reason: int, now: int) -> None:
        found = self._reception.end(source, group)
        if self._transmission.end(source, group, now) or found:
            self._line.counters.ended[reason] += 1
        else:
            self._line.counters.ignored += 1
