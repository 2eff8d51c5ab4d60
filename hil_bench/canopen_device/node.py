"""A CANopen node: the services of CiA 301 around one object dictionary, sans I/O.

Frames and the time go in, frames come out through `emit`. One round of a node::

    node.receive(frame, now)      for each frame: NMT, SYNC and RPDO act at once, SDO waits
    node.expire(now)              what did not come in time
    ...                           the application drains `node.events`, reads and sets objects
    node.transmit_pdos(now, emit)
    node.serve(now, emit)         boot-up, SDO answers, EMCY, heartbeat

`expire` and `serve` have nothing to do before `node.deadline`.
"""

from collections import deque
from typing import Any, Final

from hil_bench.canopen_device.agenda import NEVER, Agenda, Timed
from hil_bench.canopen_device.counters import NodeCounters
from hil_bench.canopen_device.emcy import COMMUNICATION, HEARTBEAT, EmcyProducer
from hil_bench.canopen_device.events import NodeEvent, NodeEventKind
from hil_bench.canopen_device.frame import Emit, Frame, Handler, Routes
from hil_bench.canopen_device.heartbeat import (
    ERROR_CONTROL,
    HeartbeatChange,
    HeartbeatConsumer,
    HeartbeatProducer,
)
from hil_bench.canopen_device.nmt import (
    ENTERED,
    NMT_COB_ID,
    RESTORED,
    NmtCommand,
    NmtRequest,
    NmtState,
)
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.pdo import Rpdo, TpdoProducer
from hil_bench.canopen_device.pdo_mapping import Direction
from hil_bench.canopen_device.pdo_parameters import COMMUNICATION_INDICES, PdoParameters
from hil_bench.canopen_device.sdo import REQUEST, SdoServer
from hil_bench.canopen_device.sync import SyncConsumer
from hil_bench.errors import ConfigError

_EVENTS: Final = 256
_COMMUNICATING: Final = frozenset({NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL})
_NO_SELF_START: Final = 1 << 2
_ERROR_BEHAVIOUR: Final = {0: NmtState.PRE_OPERATIONAL, 2: NmtState.STOPPED}


class Node:
    """One CANopen device on a bus.

    Attributes:
        node_id: 1 to 127.
        object_dictionary: its objects.
        state: its NMT state.
        events: what the application must hear of; the application drains it. Of more than 256
            undrained events the oldest are lost.
        routes: handlers of received frames by identifier; a new mapping object whenever an
            identifier changes.
        counters: what was ignored or refused.
        emcy: where the application raises and clears errors.
    """

    def __init__(self, object_dictionary: ObjectDictionary, node_id: int) -> None:
        """Compose the services; the node is silent until `start`.

        Raises:
            ConfigError: the node-ID is not 1 to 127.
        """
        if not 1 <= node_id <= 127:
            raise ConfigError(f"node-ID {node_id} is not possible; use 1 to 127")
        self.node_id = node_id
        self.object_dictionary = object_dictionary
        self.state = NmtState.INITIALISING
        self.events: deque[NodeEvent] = deque(maxlen=_EVENTS)
        self.routes: Routes = {}
        self.counters = NodeCounters()
        self._agenda = Agenda()
        self._is_started = False
        self._compose()
        self._watch_identifiers()
        self._update_routes()

    @property
    def deadline(self) -> int:
        """The next time at which `expire` or `serve` has something to do [ns]."""
        return self._agenda.due

    def start(self, now: int) -> None:
        """Power on: the next `serve` sends the boot-up message and enters PRE-OPERATIONAL.

        Where 0x1F80 is there and has bit 2 clear, OPERATIONAL follows at once (CiA 302-2).
        """
        self._is_started = True
        self._agenda.bring_forward(now)

    def receive(self, frame: Frame, now: int) -> None:
        """Take a frame from the bus: NMT, SYNC, RPDO act at once; SDO requests are queued."""
        handler = self.routes.get(frame.can_id)
        if handler is not None:
            handler(frame, now)

    def expire(self, now: int) -> None:
        """Act on what did not come in time: RPDOs and watched heartbeats."""
        if now < self._agenda.due:
            return
        for rpdo in self._rpdos:
            rpdo.expire(now)
        for node_id in self._consumer.expire(now):
            self._lose_heartbeat(node_id)

    def trigger_tpdo(self, number: int) -> None:
        """Take an application event for TPDO `number` (types 0, 254, 255)."""
        self._tpdos.trigger(number)

    def transmit_pdos(self, now: int, emit: Emit) -> None:
        """Send the TPDOs that are due, with the objects' present values."""
        if now >= self._tpdos.due:
            self._tpdos.transmit(now, emit)

    def serve(self, now: int, emit: Emit) -> None:
        """Send boot-up, SDO answers and aborts, EMCY and heartbeat, as far as they are due."""
        if now < self._agenda.due or not self._is_started:
            return
        if self.state is NmtState.INITIALISING:
            self._boot(now, emit)
        self._sdo.serve(now, emit)
        self.emcy.serve(now, emit)
        self._producer.serve(now, emit, self.state)
        self._agenda.due = self._next_due()

    def _next_due(self) -> int:
        due = NEVER
        for service in self._timed:
            if service.due < due:  # noqa: PLR1730 - min() costs more than all the rest here
                due = service.due
        return due

    def _compose(self) -> None:
        dictionary, agenda, counters = self.object_dictionary, self._agenda, self.counters
        self.emcy = EmcyProducer(dictionary, agenda, counters)
        self._sync = SyncConsumer(dictionary, self.emcy, counters)
        self._sdo = SdoServer(dictionary, self.node_id, agenda, counters)
        self._producer = HeartbeatProducer(dictionary, self.node_id, agenda)
        self._consumer = HeartbeatConsumer(dictionary, agenda, counters)
        self._rpdos = tuple(
            Rpdo(
                PdoParameters(dictionary, index, Direction.RPDO),
                *(agenda, self.events, self.emcy, counters),
            )
            for index in dictionary.indices(COMMUNICATION_INDICES[Direction.RPDO])
        )
        self._tpdos = TpdoProducer(dictionary)
        self._timed: tuple[Timed, ...] = (
            *(self._sdo, self.emcy, self._producer, self._consumer),
            *self._rpdos,
        )

    def _watch_identifiers(self) -> None:
        """Renew the routes after each write to a COB-ID, or to the nodes to be watched."""
        for variable in self.object_dictionary:
            is_pdo = any(variable.index in indices for indices in COMMUNICATION_INDICES.values())
            is_cob_id = variable.index == 0x1005 or (is_pdo and variable.subindex == 1)
            if is_cob_id or (variable.index == 0x1016 and variable.subindex):
                variable.add_hook(self._update_routes)

    def _update_routes(self, _value: Any = None) -> None:  # noqa: ANN401 - it is a hook
        routes: dict[int, Handler] = {}
        for can_id in self._tpdos.can_ids | {ERROR_CONTROL + self.node_id}:
            _add_route(routes, can_id, self._receive_own)
        for node_id in self._consumer.node_ids:
            _add_route(routes, ERROR_CONTROL + node_id, self._receive_heartbeat)
        for rpdo in self._rpdos:
            if rpdo.can_id is not None:
                _add_route(routes, rpdo.can_id, rpdo.receive)
        _add_route(routes, REQUEST + self.node_id, self._receive_sdo)
        if self._sync.can_id is not None:
            _add_route(routes, self._sync.can_id, self._receive_sync)
        _add_route(routes, NMT_COB_ID, self._receive_nmt)
        self.routes = routes

    def _is_data(self, frame: Frame) -> bool:
        """Whether it is a data frame with an 11-bit identifier; others are counted."""
        if frame.is_remote or frame.is_extended:
            self.counters.ignored_frames += 1
            return False
        return True

    def _receive_own(self, frame: Frame, _now: int) -> None:
        """Take a frame with an identifier that is ours to send: a remote request, or a stray."""
        self._is_data(frame)

    def _receive_nmt(self, frame: Frame, _now: int) -> None:
        if not self._is_data(frame):
            return
        request = NmtRequest.parse(frame.data)
        if request is None:
            self.counters.malformed_nmt += 1
        elif request.addresses(self.node_id) and self.state is not NmtState.INITIALISING:
            self._obey(request.command)

    def _receive_sync(self, frame: Frame, _now: int) -> None:
        if not self._is_data(frame) or self.state not in _COMMUNICATING:
            return
        self._sync.check_length(len(frame.data))
        for rpdo in self._rpdos:
            rpdo.synchronise()
        self._tpdos.synchronise()

    def _receive_sdo(self, frame: Frame, _now: int) -> None:
        if self._is_data(frame) and self.state in _COMMUNICATING:
            self._sdo.receive(frame.data)

    def _receive_heartbeat(self, frame: Frame, now: int) -> None:
        if not self._is_data(frame) or self.state is NmtState.INITIALISING:
            return
        node_id = frame.can_id - ERROR_CONTROL
        change = self._consumer.receive(frame, now)
        if change is HeartbeatChange.LOST:
            self._lose_heartbeat(node_id)
        elif change is HeartbeatChange.RESUMED:
            self.emcy.clear_error(HEARTBEAT, source=node_id)
            self.events.append(NodeEvent(NodeEventKind.HEARTBEAT_RESUMED, node_id))

    def _lose_heartbeat(self, node_id: int) -> None:
        self.emcy.raise_error(HEARTBEAT, COMMUNICATION, bytes([node_id]), source=node_id)
        self.events.append(NodeEvent(NodeEventKind.HEARTBEAT_LOST, node_id))
        self._follow_error_behaviour()

    def _follow_error_behaviour(self) -> None:
        """Do as 0x1029.01 says after a communication error."""
        behaviour = self.object_dictionary.number(0x1029, 1)
        state = _ERROR_BEHAVIOUR.get(behaviour)
        if state is NmtState.STOPPED or (state and self.state is NmtState.OPERATIONAL):
            self._enter(state)

    def _obey(self, command: NmtCommand) -> None:
        restored = RESTORED.get(command)
        if restored is None:
            self._enter(ENTERED[command])
            return
        self._enter(NmtState.INITIALISING)
        self.object_dictionary.restore(restored)
        self._reset_services(restored)
        is_whole = command is NmtCommand.RESET_NODE
        kind = NodeEventKind.RESET_NODE if is_whole else NodeEventKind.RESET_COMMUNICATION
        self.events.append(NodeEvent(kind, 0))

    def _reset_services(self, restored: range) -> None:
        self.emcy.reset(restored)
        self._sdo.reset()
        self._producer.stop()
        self._consumer.reset()
        for rpdo in self._rpdos:
            rpdo.reset()
        self._tpdos.reset()
        self._update_routes()
        self._agenda.bring_forward(0)

    def _boot(self, now: int, emit: Emit) -> None:
        self._producer.boot_up(now, emit)
        self._enter(NmtState.PRE_OPERATIONAL)
        startup = self.object_dictionary.number(0x1F80, absent=_NO_SELF_START)
        if not startup & _NO_SELF_START:
            self._enter(NmtState.OPERATIONAL)

    def _enter(self, state: NmtState) -> None:
        if state is self.state:
            return
        self.state = state
        is_operational = state is NmtState.OPERATIONAL
        for rpdo in self._rpdos:
            rpdo.set_operational(is_operational=is_operational)
        self._tpdos.set_operational(is_operational=is_operational)
        self.emcy.is_enabled = state in _COMMUNICATING
        if not self.emcy.is_enabled:
            self._sdo.reset()
        self._agenda.bring_forward(0)
        self.events.append(NodeEvent(NodeEventKind.STATE_CHANGED, state))


def _add_route(routes: dict[int, Handler], can_id: int, handler: Handler) -> None:
    """Add a handler, after the one that is there: two services may listen to one identifier."""
    present = routes.get(can_id)
    if present is None:
        routes[can_id] = handler
        return

    def handle_both(frame: Frame, now: int) -> None:
        present(frame, now)
        handler(frame, now)

    routes[can_id] = handle_both
