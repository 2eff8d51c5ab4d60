"""PDO services (CiA 301, process data objects): RPDO to object dictionary, and back to TPDO."""

from collections import deque
from functools import partial
from typing import Any

from hil_bench.canopen_device.agenda import NEVER, Agenda
from hil_bench.canopen_device.counters import NodeCounters
from hil_bench.canopen_device.emcy import (
    COMMUNICATION,
    PDO_TOO_LONG,
    PDO_TOO_SHORT,
    RPDO_TIMEOUT,
    EmcyProducer,
)
from hil_bench.canopen_device.events import NodeEvent, NodeEventKind
from hil_bench.canopen_device.frame import Emit, Frame
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.pdo_mapping import Direction, PdoMapping
from hil_bench.canopen_device.pdo_parameters import (
    COMMUNICATION_INDICES,
    EVENT_DRIVEN,
    SYNCHRONOUS,
    SYNCHRONOUS_ACYCLIC,
    PdoParameters,
)


class Rpdo:
    """One receive PDO.

    Synchronous ones (types 0 to 240) act with the SYNC after them, the others at once. With an
    event timer, each RPDO must follow the last within that time; the first one starts it.

    Attributes:
        number: 1 to 512.
        can_id: its identifier, None while it is disabled.
        due: when it times out [ns].
    """

    def __init__(
        self,
        parameters: PdoParameters,
        agenda: Agenda,
        events: deque[NodeEvent],
        emcy: EmcyProducer,
        counters: NodeCounters,
    ) -> None:
        self.number = parameters.number
        self.due = NEVER
        self._parameters = parameters
        self._agenda = agenda
        self._events = events
        self._emcy = emcy
        self._counters = counters
        self._received = NodeEvent(NodeEventKind.RPDO_RECEIVED, self.number)
        self._is_operational = False
        self._has_failed = False
        self.configure()
        parameters.add_hook(lambda _value: self.configure())

    def configure(self) -> None:
        """Follow the parameters."""
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
        self._has_failed = False
        self.configure()

    def receive(self, frame: Frame, now: int) -> None:
        """Take a frame with this RPDO's identifier."""
        mapping = self._mapping
        if mapping is None or not self._is_operational:
            return
        _, data, is_remote, is_extended = frame
        if is_remote or is_extended:
            self._counters.ignored_frames += 1
            return
        if (len(data) != mapping.length or self._has_failed) and not self._judge(data, mapping):
            return
        if self._event_time:
            self._restart_timer(now)
        if self._is_synchronous:
            self._waiting = data
        else:
            self._apply(mapping, data)

    def synchronise(self) -> None:
        """Act on the last synchronous RPDO, if one came since the last SYNC."""
        if self._waiting is not None and self._mapping is not None:
            self._apply(self._mapping, self._waiting)
            self._waiting = None

    def expire(self, now: int) -> None:
        """Report a time-out, once, until the next RPDO."""
        if now < self.due:
            return
        self.due = NEVER
        self._has_failed = True
        self._emcy.raise_error(RPDO_TIMEOUT, COMMUNICATION, source=self.number)
        self._events.append(NodeEvent(NodeEventKind.RPDO_TIMEOUT, self.number))

    def _apply(self, mapping: PdoMapping, data: bytes) -> None:
        refused = mapping.write(data)
        if refused:
            self._counters.refused_values += refused
        self._events.append(self._received)

    def _restart_timer(self, now: int) -> None:
        was_running = self.due != NEVER
        self.due = now + self._event_time
        if not was_running:
            self._agenda.bring_forward(self.due)

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


class Tpdo:
    """One transmit PDO.

    Type 0 goes with the SYNC after an event, types 1 to 240 with every n-th SYNC. Types 254 and
    255 go on an event and when their event timer has run out, never sooner after the last than
    the inhibit time, and once on entering OPERATIONAL.

    Attributes:
        can_id: its identifier, None while it is disabled.
        due: when it is to be sent [ns].
    """

    def __init__(self, parameters: PdoParameters) -> None:
        self.due = NEVER
        self._parameters = parameters
        self._is_operational = False
        self._inhibited_until = 0
        self._syncs = 0
        self.configure()

    def configure(self) -> None:
        """Follow the parameters; an event-driven PDO starts anew with a transmission."""
        self.can_id = self._parameters.can_id
        self._mapping = self._parameters.mapping()
        self._type = self._parameters.transmission_type
        self._is_event_driven = self._type in EVENT_DRIVEN
        self._event_time = self._parameters.event_time
        self._inhibit_time = self._parameters.inhibit_time
        self._begin()

    def set_operational(self, *, is_operational: bool) -> None:
        """Begin or end to transmit."""
        self._is_operational = is_operational
        self._begin()

    def trigger(self) -> None:
        """Take an event of the application."""
        if self._is_event_driven and self._is_active:
            self.due = min(self.due, self._inhibited_until)
        self._has_event = True

    def synchronise(self) -> None:
        """Take a SYNC."""
        if not self._is_active or self._is_event_driven:
            return
        if self._type == SYNCHRONOUS_ACYCLIC:
            is_due = self._has_event
        else:
            self._syncs += 1
            is_due = self._syncs >= self._type
        if is_due:
            self._syncs = 0
            self.due = 0

    def transmit(self, now: int, emit: Emit) -> None:
        """Send it with the present values."""
        if self.can_id is None or self._mapping is None:
            return
        emit(Frame(self.can_id, self._mapping.read()))
        self._has_event = False
        self.due = NEVER
        if self._is_event_driven:
            self._inhibited_until = now + self._inhibit_time
            if self._event_time:
                self.due = now + max(self._event_time, self._inhibit_time)

    def _begin(self) -> None:
        self._is_active = (
            self._is_operational and self.can_id is not None and self._mapping is not None
        )
        self._has_event = False
        self._syncs = 0
        starts = self._is_active and self._is_event_driven
        self.due = self._inhibited_until if starts else NEVER


class TpdoProducer:
    """All transmit PDOs of a node.

    Attributes:
        due: when `transmit` has something to send [ns].
    """

    def __init__(self, object_dictionary: ObjectDictionary) -> None:
        self.due = NEVER
        self._tpdos: dict[int, Tpdo] = {}
        for index in object_dictionary.indices(COMMUNICATION_INDICES[Direction.TPDO]):
            parameters = PdoParameters(object_dictionary, index, Direction.TPDO)
            tpdo = Tpdo(parameters)
            self._tpdos[parameters.number] = tpdo
            parameters.add_hook(partial(self._configure, tpdo))

    @property
    def can_ids(self) -> frozenset[int]:
        """The identifiers in use."""
        return frozenset(tpdo.can_id for tpdo in self._tpdos.values() if tpdo.can_id is not None)

    def trigger(self, number: int) -> None:
        """Take an application event for TPDO `number`; without effect where there is none."""
        tpdo = self._tpdos.get(number)
        if tpdo is not None:
            tpdo.trigger()
            self.due = min(self.due, tpdo.due)

    def synchronise(self) -> None:
        """Take a SYNC."""
        for tpdo in self._tpdos.values():
            tpdo.synchronise()
        self._update_due()

    def transmit(self, now: int, emit: Emit) -> None:
        """Send the PDOs that are due, in the order of their numbers."""
        if now < self.due:
            return
        for tpdo in self._tpdos.values():
            if now >= tpdo.due:
                tpdo.transmit(now, emit)
        self._update_due()

    def set_operational(self, *, is_operational: bool) -> None:
        """Begin or end to transmit."""
        for tpdo in self._tpdos.values():
            tpdo.set_operational(is_operational=is_operational)
        self._update_due()

    def reset(self) -> None:
        """Begin anew after the parameters got their defaults."""
        for tpdo in self._tpdos.values():
            tpdo.configure()
        self._update_due()

    def _configure(self, tpdo: Tpdo, _value: Any) -> None:  # noqa: ANN401 - it is a hook
        tpdo.configure()
        self._update_due()

    def _update_due(self) -> None:
        self.due = min([tpdo.due for tpdo in self._tpdos.values()], default=NEVER)
