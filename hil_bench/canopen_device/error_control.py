"""Error control of a node: heartbeat, life guarding, and its behaviour on errors."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.agenda import MILLISECOND, NEVER, Agenda
from hil_bench.canopen_device.emcy import COMMUNICATION, HEARTBEAT, EmcyProducer
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.events import NodeEvent, NodeEventKind, NodeEvents
from hil_bench.canopen_device.frame import Emit, Frame, Handler
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.service import NodeCounters, Service

# Heartbeat producer 0x1017 and consumer 0x1016 (CiA 301, error control).

ERROR_CONTROL: Final = 0x700
"""Identifier of boot-up and heartbeat, plus the node-ID."""

_STATES: Final = frozenset(NmtState)


class HeartbeatProducer:
    """Sends the boot-up message, then the NMT state every 0x1017 ms.

    The boot-up message counts as the first heartbeat. A new producer time acts at once: the next
    heartbeat comes immediately, the following ones in the new period.

    Attributes:
        due: when the next heartbeat is to be sent [ns].
    """

    def __init__(self, object_dictionary: ObjectDictionary, node_id: int, agenda: Agenda) -> None:
        self.due = NEVER
        self._producer_time = object_dictionary.find(0x1017)
        self._can_id = ERROR_CONTROL + node_id
        self._agenda = agenda
        if self._producer_time is not None:
            self._producer_time.add_hook(self._start_anew)

    def boot_up(self, now: int, emit: Emit) -> None:
        """Send the boot-up message and start the period."""
        emit(Frame(self._can_id, bytes([NmtState.INITIALISING])))
        period = self._period()
        self.due = now + period if period else NEVER

    def serve(self, now: int, emit: Emit, state: NmtState) -> None:
        """Send a heartbeat if it is due."""
        if now < self.due:
            return
        emit(Frame(self._can_id, bytes([state])))
        period = self._period()
        # On the grid of the period, unless it has just begun (due 0) or was missed altogether.
        following = (self.due or now) + period
        self.due = following if following > now else now + period

    def reset(self, node_id: int) -> None:
        """Send nothing until the next boot-up, which is that of the device `node_id`."""
        self._can_id = ERROR_CONTROL + node_id
        self.due = NEVER

    def _period(self) -> int:
        return self._producer_time.value * MILLISECOND if self._producer_time is not None else 0

    def _start_anew(self, milliseconds: int) -> None:
        self.due = 0 if milliseconds else NEVER
        self._agenda.bring_forward(self.due)


@dataclass(slots=True)
class _Watch:
    """One watched node; `due` is the time of loss [ns], NEVER before the first heartbeat."""

    period: int
    due: int = NEVER
    is_lost: bool = False


class HeartbeatConsumer:
    """Watches the heartbeats of the nodes that 0x1016 names.

    Watching begins with a node's first heartbeat. A boot-up message is none: of a node that is
    watched it means a loss, and watching begins again with the heartbeat after it. A loss is
    reported by EMCY 0x8130 and an event. The error is gone with the next heartbeat, and when 0x1016
    no longer names the node or gives it another time.

    Attributes:
        due: the earliest time at which a node may be lost [ns]; never too late, but too early
            where heartbeats came since.
    """

    def __init__(
        self,
        object_dictionary: ObjectDictionary,
        agenda: Agenda,
        events: NodeEvents,
        emcy: EmcyProducer,
        counters: NodeCounters,
    ) -> None:
        self._object_dictionary = object_dictionary
        self._agenda = agenda
        self._events = events
        self._emcy = emcy
        self._counters = counters
        self._watches: dict[int, _Watch] = {}
        self.due = NEVER
        for subindex in self._entries():
            if object_dictionary.find(0x1016, subindex) is not None:
                self._add_check(subindex)
                object_dictionary.add_hook(0x1016, subindex, self._set_watches)
        self._set_watches(0)

    @property
    def node_ids(self) -> frozenset[int]:
        """The watched nodes."""
        return frozenset(self._watches)

    def receive(self, frame: Frame, now: int) -> bool:
        """Take a boot-up or heartbeat message; return whether it means that its sender was lost."""
        node_id = frame.can_id - ERROR_CONTROL
        watch = self._watches.get(node_id)
        if watch is None:
            return False
        if len(frame.data) != 1 or frame.data[0] not in _STATES:
            self._counters.malformed_heartbeats += 1
            return False
        if frame.data[0] == NmtState.INITIALISING:
            return self._lose(node_id, watch)
        watch.due = now + watch.period
        self.due = min(self.due, watch.due)
        self._agenda.bring_forward(watch.due)
        self._resume(node_id, watch)
        return False

    def expire(self, now: int) -> bool:
        """Report the nodes whose heartbeat failed to come; return whether there is one."""
        if now < self.due:
            return False
        late = [entry for entry in self._watches.items() if now >= entry[1].due]
        for node_id, watch in late:
            self._lose(node_id, watch)
        self._update_due()
        return bool(late)

    def reset(self) -> None:
        """Watch what 0x1016 says, from the first heartbeats on."""
        self._watches = {}
        self._set_watches(0)

    def _lose(self, node_id: int, watch: _Watch) -> bool:
        """Stop watching until the next heartbeat; return whether the node was watched."""
        if watch.due == NEVER:
            return False
        watch.due = NEVER
        watch.is_lost = True
        self._emcy.raise_error(HEARTBEAT, COMMUNICATION, bytes([node_id]), source=node_id)
        self._events.tell(NodeEvent(NodeEventKind.HEARTBEAT_LOST, node_id))
        return True

    def _resume(self, node_id: int, watch: _Watch) -> None:
        """Report that a loss is over, where there was one."""
        if watch.is_lost:
            watch.is_lost = False
            self._emcy.clear_error(HEARTBEAT, source=node_id)
            self._events.tell(NodeEvent(NodeEventKind.HEARTBEAT_RESUMED, node_id))

    def _entries(self) -> range:
        return range(1, self._object_dictionary.number(0x1016) + 1)

    def _set_watches(self, _value: int) -> None:
        """Follow 0x1016; a node whose entry did not change stays watched as it is."""
        watches = {}
        for subindex in self._entries():
            entry = _parse_entry(self._object_dictionary.number(0x1016, subindex))
            if entry is None:
                continue
            watch = self._watches.get(entry.node_id)
            is_same = watch is not None and watch.period == entry.period
            watches[entry.node_id] = watch if watch and is_same else _Watch(entry.period)
        for node_id, watch in self._watches.items():
            if watches.get(node_id) is not watch:
                self._resume(node_id, watch)
        self._watches = watches
        self._update_due()

    def _update_due(self) -> None:
        self.due = min((watch.due for watch in self._watches.values()), default=NEVER)

    def _add_check(self, subindex: int) -> None:
        def refuse_duplicate(value: int) -> None:
            """Refuse a node that another entry names (CiA 301, 0x1016).

            Raises:
                SdoAbort: 0604 0043.
            """
            entry = _parse_entry(value)
            others = (sub for sub in self._entries() if sub != subindex)
            for other in others:
                named = _parse_entry(self._object_dictionary.number(0x1016, other))
                if entry and named and entry.node_id == named.node_id:
                    raise SdoAbort(*abort_codes.PARAMETER_INCOMPATIBLE)

        self._object_dictionary.add_check(0x1016, subindex, refuse_duplicate)


class _Entry(NamedTuple):
    node_id: int
    period: int


def _parse_entry(value: int) -> _Entry | None:
    """An entry of 0x1016: bits 16 to 23 node-ID, bits 0 to 15 time [ms]; None where unused."""
    node_id, milliseconds = value >> 16 & 0xFF, value & 0xFFFF
    if not milliseconds or not 1 <= node_id <= 127:
        return None
    return _Entry(node_id, milliseconds * MILLISECOND)


# Node guarding and life guarding (CiA 301, error control): 0x100C, 0x100D.
#
# The NMT master asks with a remote frame; the answer is the NMT state, with a toggle bit that is
# 0 in the first answer after boot-up. Once asked, the device expects to be asked again within the
# life time, 0x100C ms times 0x100D; if it is not, that is a life guarding event.
#
# Heartbeat excludes guarding: while 0x1017 is not 0, remote requests get no answer. The same
# holds for a device without 0x100C.

_HEARTBEAT_TIME: Final = 0x1017
_GUARD_TIME: Final = 0x100C
_LIFE_TIME_FACTOR: Final = 0x100D

_TOGGLE: Final = 0x80
_LOST: Final = NodeEvent(NodeEventKind.GUARDING_LOST, 0)
_RESUMED: Final = NodeEvent(NodeEventKind.GUARDING_RESUMED, 0)


class NodeGuarding:
    """Answers the master's guarding, and notices when it stops.

    A life guarding event is reported by EMCY 0x8130 and an event; the error is gone when the master
    asks again, or when guarding is switched off. Requests within one round get one answer.

    Attributes:
        due: when the life time is over [ns].
    """

    def __init__(
        self,
        object_dictionary: ObjectDictionary,
        node_id: int,
        agenda: Agenda,
        events: NodeEvents,
        emcy: EmcyProducer,
    ) -> None:
        self.due = NEVER
        self._object_dictionary = object_dictionary
        self._agenda = agenda
        self._events = events
        self._emcy = emcy
        self._requests = 0
        self._is_lost = False
        self._toggle = 0
        self._can_id = ERROR_CONTROL + node_id
        for index in (_HEARTBEAT_TIME, _GUARD_TIME, _LIFE_TIME_FACTOR):
            if index in object_dictionary:
                object_dictionary.add_hook(index, 0, self._start_anew)

    def receive(self, now: int) -> bool:
        """Take a remote request; return whether it will be answered."""
        if not self._is_active():
            return False
        self._requests += 1
        self._agenda.bring_forward(0)
        life_time = self._life_time()
        self.due = now + life_time if life_time else NEVER
        self._resume()
        return True

    def expire(self, now: int) -> bool:
        """Report a life guarding event; return whether there is one."""
        if now < self.due:
            return False
        self.due = NEVER
        self._is_lost = True
        self._emcy.raise_error(HEARTBEAT, COMMUNICATION)
        self._events.tell(_LOST)
        return True

    def serve(self, emit: Emit, state: NmtState) -> None:
        """Answer each request, the toggle bit alternating."""
        while self._requests:
            self._requests -= 1
            emit(Frame(self._can_id, bytes([self._toggle | state])))
            self._toggle ^= _TOGGLE

    def reset(self, node_id: int) -> None:
        """Begin anew, for the device `node_id`."""
        self._can_id = ERROR_CONTROL + node_id
        self._requests = 0
        self._toggle = 0
        self._is_lost = False
        self.due = NEVER

    def _is_active(self) -> bool:
        has_heartbeat = self._object_dictionary.number(_HEARTBEAT_TIME)
        return not has_heartbeat and _GUARD_TIME in self._object_dictionary

    def _life_time(self) -> int:
        guard_time = self._object_dictionary.number(_GUARD_TIME) * MILLISECOND
        return guard_time * self._object_dictionary.number(_LIFE_TIME_FACTOR)

    def _start_anew(self, _value: int) -> None:
        """Wait for the master's first request again."""
        self.due = NEVER
        self._resume()

    def _resume(self) -> None:
        """Report that a loss is over, where there was one."""
        if self._is_lost:
            self._is_lost = False
            self._emcy.clear_error(HEARTBEAT)
            self._events.tell(_RESUMED)


# Error control (CiA 301): boot-up message, heartbeat and guarding of one node.


class ErrorControl(Service):
    """Says that the node is there, and notices when others are not any more."""

    def __init__(
        self,
        object_dictionary: ObjectDictionary,
        node_id: int,
        agenda: Agenda,
        events: NodeEvents,
        emcy: EmcyProducer,
        counters: NodeCounters,
    ) -> None:
        self._node_id = node_id
        self._state = NmtState.INITIALISING
        self._counters = counters
        self._producer = HeartbeatProducer(object_dictionary, node_id, agenda)
        self._consumer = HeartbeatConsumer(object_dictionary, agenda, events, emcy, counters)
        self._guarding = NodeGuarding(object_dictionary, node_id, agenda, events, emcy)

    @property
    def heartbeat_ids(self) -> list[int]:
        """The identifiers of the heartbeats that this node watches."""
        return [ERROR_CONTROL + node_id for node_id in self._consumer.node_ids]

    def handlers(self) -> Iterator[tuple[int | None, Handler]]:
        """Yield the handler of the master's guarding."""
        yield ERROR_CONTROL + self._node_id, self._receive_guarding

    def enter(self, state: NmtState) -> None:
        """Report `state` from now on."""
        self._state = state

    def reset(self, node_id: int) -> None:
        """Begin anew, for the device `node_id`."""
        self._node_id = node_id
        self._producer.reset(node_id)
        self._consumer.reset()
        self._guarding.reset(node_id)

    def boot_up(self, now: int, emit: Emit) -> None:
        """Send the boot-up message."""
        self._producer.boot_up(now, emit)

    def serve(self, now: int, emit: Emit) -> int:
        """Answer the master's guarding, and send the heartbeat that is due."""
        self._guarding.serve(emit, self._state)
        self._producer.serve(now, emit, self._state)
        return min(self._producer.due, self._consumer.due, self._guarding.due)

    def expire(self, now: int) -> bool:
        """Return True if a heartbeat, or the master's guarding, failed to come in time."""
        is_heartbeat_lost = self._consumer.expire(now)
        return self._guarding.expire(now) or is_heartbeat_lost

    def receive_heartbeat(self, frame: Frame, now: int) -> bool:
        """Take a message of a watched node; return whether it means that the node was lost."""
        if not self._counters.is_data(frame) or self._state is NmtState.INITIALISING:
            return False
        return self._consumer.receive(frame, now)

    def _receive_guarding(self, frame: Frame, now: int) -> None:
        """Take a frame with our own error control identifier: the master's request, or a stray."""
        is_request = frame.is_remote and not frame.is_extended
        is_up = self._state is not NmtState.INITIALISING
        if not (is_request and is_up and self._guarding.receive(now)):
            self._counters.is_data(frame)


# Error behaviour 0x1029 (CiA 301): the NMT state that an error leads to.
#
# Sub-index 1 is for communication errors: a lost heartbeat, a life guarding event. The others are
# for the error classes of the device profile. Values: 0 to PRE-OPERATIONAL if OPERATIONAL, 1 no
# change, 2 to STOPPED.

COMMUNICATION_ERROR: Final = 1
"""Sub-index of communication errors."""

_OBJECT: Final = 0x1029
_PRE_OPERATIONAL: Final = 0
_STOPPED: Final = 2


class ErrorBehaviour:
    """Knows what 0x1029 asks for; where it is absent, that is PRE-OPERATIONAL."""

    def __init__(self, object_dictionary: ObjectDictionary) -> None:
        self._object_dictionary = object_dictionary
        for variable in object_dictionary:
            if variable.index == _OBJECT and variable.subindex:
                variable.add_check(_check)

    def state_after(self, subindex: int, state: NmtState) -> NmtState | None:
        """Return the NMT state after an error of the class `subindex`, None for no change."""
        behaviour = self._object_dictionary.number(_OBJECT, subindex)
        if behaviour == _STOPPED:
            return NmtState.STOPPED
        if behaviour == _PRE_OPERATIONAL and state is NmtState.OPERATIONAL:
            return NmtState.PRE_OPERATIONAL
        return None


def _check(value: int) -> None:
    """Refuse values that mean nothing.

    Raises:
        SdoAbort: 0609 0030.
    """
    if value > _STOPPED:
        raise SdoAbort(*abort_codes.VALUE)
