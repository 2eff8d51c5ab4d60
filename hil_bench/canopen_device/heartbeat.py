"""Heartbeat producer 0x1017 and consumer 0x1016 (CiA 301, error control)."""

from dataclasses import dataclass
from typing import Final, NamedTuple

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.agenda import MILLISECOND, NEVER, Agenda
from hil_bench.canopen_device.counters import NodeCounters
from hil_bench.canopen_device.emcy import COMMUNICATION, HEARTBEAT, EmcyProducer
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.events import NodeEvent, NodeEventKind, NodeEvents
from hil_bench.canopen_device.frame import Emit, Frame
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.canopen_device.object_dictionary import ObjectDictionary

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
