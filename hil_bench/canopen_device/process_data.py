"""Received PDOs, and the PDOs of a node together."""

from collections.abc import Iterator

from hil_bench.canopen_device.agenda import NEVER, Agenda
from hil_bench.canopen_device.emcy import (
    COMMUNICATION,
    PDO_TOO_LONG,
    PDO_TOO_SHORT,
    RPDO_TIMEOUT,
    EmcyProducer,
)
from hil_bench.canopen_device.events import NodeEvent, NodeEventKind, NodeEvents
from hil_bench.canopen_device.frame import Emit, Frame, Handler
from hil_bench.canopen_device.nmt import COMMUNICATING, NmtState
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.pdo_parameters import (
    COMMUNICATION_INDICES,
    SYNCHRONOUS,
    Direction,
    PdoMapping,
    PdoParameters,
)
from hil_bench.canopen_device.service import NodeCounters, Service
from hil_bench.canopen_device.sync import SyncConsumer, SynchronousWindow, SyncProducer
from hil_bench.canopen_device.tpdo import TpdoProducer

# Receive PDOs (CiA 301, process data objects): from the bus to the object dictionary.


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


# Process data of one node (CiA 301): all PDOs, and the SYNC that they follow.


class ProcessData(Service):
    """Lets each SYNC act on the RPDOs first, then on the TPDOs.

    Attributes:
        sync: the consumer of SYNC.
        tpdos: the transmit PDOs.
    """

    def __init__(
        self,
        object_dictionary: ObjectDictionary,
        agenda: Agenda,
        events: NodeEvents,
        emcy: EmcyProducer,
        counters: NodeCounters,
    ) -> None:
        window = SynchronousWindow()
        self._counters = counters
        self._is_communicating = False
        self.sync = SyncConsumer(object_dictionary, window, emcy, counters)
        self._producer = SyncProducer(object_dictionary, agenda)
        self._rpdos = tuple(
            Rpdo(
                PdoParameters(object_dictionary, index, Direction.RPDO),
                agenda,
                window,
                events,
                emcy,
                counters,
            )
            for index in object_dictionary.indices(COMMUNICATION_INDICES[Direction.RPDO])
        )
        self.tpdos = TpdoProducer(object_dictionary, window, counters)

    def handlers(self) -> Iterator[tuple[int | None, Handler]]:
        """Yield those of PDOs, then that of SYNC: an RPDO acts with a SYNC of its identifier."""
        for can_id in self.tpdos.can_ids:
            yield can_id, self.tpdos.receive
        for rpdo in self._rpdos:
            yield rpdo.can_id, rpdo.receive
        yield self.sync.can_id, self._receive_sync

    def enter(self, state: NmtState) -> None:
        """Begin or end to take and send PDOs and SYNC."""
        is_operational = state is NmtState.OPERATIONAL
        self._is_communicating = state in COMMUNICATING
        for rpdo in self._rpdos:
            rpdo.set_operational(is_operational=is_operational)
        self.tpdos.set_operational(is_operational=is_operational)
        self._producer.set_enabled(is_enabled=self._is_communicating)

    def reset(self, node_id: int) -> None:  # noqa: ARG002 - identifiers come from the objects
        """Begin anew after the parameters got their power-on values."""
        self.sync.reset()
        for rpdo in self._rpdos:
            rpdo.reset()
        self.tpdos.reset()

    def serve(self, now: int, emit: Emit) -> int:  # noqa: ARG002 - `tpdos` sends, before the rest
        """Return when SYNC is to be produced, or an RPDO times out [ns]."""
        return min((self._producer.due, *(rpdo.due for rpdo in self._rpdos)))

    def expire(self, now: int) -> None:
        """Produce the SYNC that is due, and report the RPDOs that failed to come in time."""
        sync = self._producer.expire(now)
        if sync is not None:
            self._synchronise(sync.data, now, sync)
        for rpdo in self._rpdos:
            rpdo.expire(now)

    def _receive_sync(self, frame: Frame, now: int) -> None:
        _, data, is_remote, is_extended, _, _ = frame
        if is_remote or is_extended:
            self._counters.ignored_frames += 1
        elif self._is_communicating and not self._producer.is_producing:
            self._synchronise(data, now)

    def _synchronise(self, data: bytes, now: int, own: Frame | None = None) -> None:
        """Act on a SYNC; `own` is the frame where this node produces it.

        PDOs that still wait for their turn since the last SYNC keep the values that they had then.
        """
        if not self.tpdos.due:
            self.tpdos.settle(now)
        counter = self.sync.receive(data, now)
        for rpdo in self._rpdos:
            rpdo.synchronise()
        self.tpdos.synchronise(counter, own)
