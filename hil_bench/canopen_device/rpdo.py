"""Receive PDOs (CiA 301, process data objects): from the bus to the object dictionary."""

from hil_bench.canopen_device.agenda import NEVER, Agenda
from hil_bench.canopen_device.emcy import (
    COMMUNICATION,
    PDO_TOO_LONG,
    PDO_TOO_SHORT,
    RPDO_TIMEOUT,
    EmcyProducer,
)
from hil_bench.canopen_device.events import NodeEvent, NodeEventKind, NodeEvents
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.pdo_mapping import PdoMapping
from hil_bench.canopen_device.pdo_parameters import SYNCHRONOUS, PdoParameters
from hil_bench.canopen_device.service import NodeCounters
from hil_bench.canopen_device.sync import SynchronousWindow


class Rpdo:
    """One receive PDO.

    Synchronous ones (types 0 to 240) act with the SYNC after them, the others at once; a
    synchronous one that comes after the synchronous window is discarded. With an event timer, each
    RPDO must follow the last within that time; the first one starts it. Errors of the RPDO are gone
    when its parameters are written, since supervision then begins anew.

    Attributes:
        number: 1 to 512.
        can_id: its identifier, None while it is disabled.
        due: when it times out [ns].
    """

    def __init__(
        self,
        parameters: PdoParameters,
        agenda: Agenda,
        window: SynchronousWindow,
        events: NodeEvents,
        emcy: EmcyProducer,
        counters: NodeCounters,
    ) -> None:
        self.number = parameters.number
        self.due = NEVER
        self._parameters = parameters
        self._agenda = agenda
        self._window = window
        self._events = events
        self._emcy = emcy
        self._counters = counters
        self._is_operational = False
        self._has_failed = False
        self.configure()
        parameters.add_hook(lambda _value: self.configure())

    def configure(self) -> None:
        """Follow the parameters."""
        self._clear_errors()
        self.can_id = self._parameters.can_id
        self._mapping = self._parameters.mapping()
        self._is_synchronous = self._parameters.transmission_type in SYNCHRONOUS
        self._event_time = self._parameters.event_time
        self._waiting: bytes | None = None
        self.due = NEVER

    def set_operational(self, *, is_operational: bool) -> None:
        """Begin or end to act on frames."""
        self._is_operational = is_operational
        self._waiting = None
        self.due = NEVER

    def reset(self) -> None:
        """Begin anew after the parameters got their defaults."""
        self.configure()

    def receive(self, frame: Frame, now: int) -> None:
        """Take a frame with this RPDO's identifier."""
        mapping = self._mapping
        if mapping is None or not self._is_operational:
            return
        _, data, is_remote, is_extended, _, _ = frame
        if is_remote or is_extended:
            self._counters.ignored_frames += 1
            return
        if (len(data) != mapping.length or self._has_failed) and not self._judge(data, mapping):
            return
        if self._event_time:
            self._restart_timer(now)
        if not self._is_synchronous:
            self._counters.refused_values += mapping.write(data)
        elif now > self._window.end:
            self._counters.late_synchronous_pdos += 1
        else:
            self._waiting = data

    def synchronise(self) -> None:
        """Act on the last synchronous RPDO, if one came since the last SYNC."""
        if self._waiting is not None and self._mapping is not None:
            self._counters.refused_values += self._mapping.write(self._waiting)
            self._waiting = None

    def expire(self, now: int) -> None:
        """Report a time-out, once, until the next RPDO."""
        if now < self.due:
            return
        self.due = NEVER
        self._has_failed = True
        self._emcy.raise_error(RPDO_TIMEOUT, COMMUNICATION, source=self.number)
        self._events.tell(NodeEvent(NodeEventKind.RPDO_TIMEOUT, self.number))

    def _restart_timer(self, now: int) -> None:
        was_running = self.due != NEVER
        self.due = now + self._event_time
        if not was_running:
            self._agenda.bring_forward(self.due)

    def _clear_errors(self) -> None:
        if self._has_failed:
            self._has_failed = False
            for code in (RPDO_TIMEOUT, PDO_TOO_SHORT, PDO_TOO_LONG):
                self._emcy.clear_error(code, source=self.number)

    def _judge(self, data: bytes, mapping: PdoMapping) -> bool:
        """Raise or clear the errors that the frame's length means; whether to process it."""
        self._has_failed = len(data) != mapping.length
        if len(data) < mapping.length:
            self._counters.short_rpdos += 1
            self._emcy.raise_error(PDO_TOO_SHORT, COMMUNICATION, source=self.number)
            return False
        self._emcy.clear_error(RPDO_TIMEOUT, source=self.number)
        self._emcy.clear_error(PDO_TOO_SHORT, source=self.number)
        if len(data) > mapping.length:
            self._counters.long_rpdos += 1
            self._emcy.raise_error(PDO_TOO_LONG, COMMUNICATION, source=self.number)
        else:
            self._emcy.clear_error(PDO_TOO_LONG, source=self.number)
        return True
