"""A CANopen node: the services of CiA 301 and CiA 305 around one object dictionary, sans I/O.

Frames and the time go in, frames come out through `emit`. One round of a node::

    node.receive(frame, now)      for each frame: NMT, SYNC and RPDO act at once, SDO waits
    node.expire(now)              what did not come in time, and the SYNC that is due
    ...                           the application drains `node.events`, reads and sets objects
    node.transmit_pdos(now, emit)
    node.serve(now, emit)         boot-up, SDO answers, EMCY, heartbeat

`expire` and `serve` have nothing to do before `node.deadline`.
"""

from collections.abc import Collection

from hil_bench.canopen_device.agenda import Agenda
from hil_bench.canopen_device.counters import NodeCounters
from hil_bench.canopen_device.error_behaviour import COMMUNICATION_ERROR
from hil_bench.canopen_device.events import NodeEvent, NodeEventKind, NodeEvents
from hil_bench.canopen_device.frame import Emit, Frame, Routes
from hil_bench.canopen_device.heartbeat import ERROR_CONTROL
from hil_bench.canopen_device.lss import LSS_REQUEST
from hil_bench.canopen_device.nmt import (
    ENTERED,
    NMT_COB_ID,
    RESTORED,
    UNCONFIGURED,
    NmtCommand,
    NmtRequest,
    NmtState,
)
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.routing import RouteTable, names_identifier
from hil_bench.canopen_device.services import COMMUNICATING, Services
from hil_bench.canopen_device.storage import MemoryStorage, Storage
from hil_bench.canopen_device.time_stamp import TimeOfDay
from hil_bench.errors import ConfigError


class Node:
    """One CANopen device on a bus.

    Attributes:
        node_id: 1 to 127; 255 while the device has none and waits for LSS.
        object_dictionary: its objects.
        state: its NMT state.
        events: what the application must hear of; the application drains it.
        routes: handlers of received frames by identifier; a new mapping object whenever an
            identifier changes, which makes the node due at once.
        counters: what was ignored or refused.
        emcy: where the application raises and clears errors.
    """

    def __init__(
        self,
        object_dictionary: ObjectDictionary,
        node_id: int,
        storage: Storage | None = None,
        agenda: Agenda | None = None,
    ) -> None:
        """Compose the services; the node is silent until `start`.

        Args:
            object_dictionary: its objects, with the defaults of `node_id`.
            node_id: 1 to 127, or 255 for none; a node-ID that LSS stored takes its place.
            storage: its non-volatile memory; without it, what is stored lives as long as the node.
            agenda: one that several nodes share, which each of them brings forward with its own.

        Raises:
            ConfigError: the node-ID is none of these, or LSS cannot give one.
        """
        if not 1 <= node_id <= 127 and node_id != UNCONFIGURED:
            raise ConfigError(f"node-ID {node_id} is not possible; use 1 to 127, or 255 for none")
        self.object_dictionary = object_dictionary
        self.state = NmtState.INITIALISING
        self.events = NodeEvents()
        self.routes: Routes = {}
        self.counters = NodeCounters()
        self._agenda = Agenda(agenda)
        self._is_started = False
        self._is_silent = False
        self._services = Services(
            object_dictionary,
            *(node_id, storage or MemoryStorage(), self._agenda, self.events, self.counters),
        )
        self._rest = self._services.agenda
        self._tpdos = self._services.tpdos
        self.node_id = self._services.node_id
        self.emcy = self._services.emcy
        if self.node_id == UNCONFIGURED and not self._services.lss.is_available:
            raise ConfigError(
                f"{object_dictionary.source}: a node without node-ID needs the objects 0x1018.01 "
                "to 0x1018.04, which LSS finds it by"
            )
        self._watch_identifiers()
        self._update_routes()

    @property
    def deadline(self) -> int:
        """The next time at which `expire` or `serve` has something to do [ns]."""
        return self._agenda.due

    @property
    def sync_id(self) -> int | None:
        """Identifier of SYNC, None where the device knows none."""
        return self._services.sync.can_id

    @property
    def sdo_ids(self) -> Collection[int]:
        """Identifiers of the requests that this node's SDO servers take."""
        return self._services.sdo.handlers.keys()

    @property
    def syncs(self) -> int:
        """How many SYNCs it has taken."""
        return self._services.sync.received

    @property
    def storage_problem(self) -> str | None:
        """Why parameters are not used or not stored, for people; None where all is well."""
        store = self._services.store
        return store.unwritten or store.problem

    def time_of_day(self, now: int) -> TimeOfDay | None:
        """Return the time of day at `now` [ns] by the last TIME message, None before the first."""
        return self._services.time.time_of_day(now)

    def start(self, now: int) -> None:
        """Power on: the next `serve` sends the boot-up message and enters PRE-OPERATIONAL.

        Where 0x1F80 is there and has bit 2 clear, OPERATIONAL follows at once (CiA 302-2). A node
        without node-ID stays silent until LSS gives it one.
        """
        self._is_started = True
        self._rest.bring_forward(now)

    def receive(self, frame: Frame, now: int) -> None:
        """Take a frame from the bus: NMT, SYNC, RPDO act at once; SDO requests are queued."""
        handler = self.routes.get(frame.can_id)
        if handler is not None:
            handler(frame, now)

    def expire(self, now: int) -> None:
        """Act on what did not come in time, and produce SYNC where this node does that."""
        if now < self._rest.due:
            return
        if self._is_silent and now >= self._services.lss.silent_until:
            self._is_silent = False
            self._update_routes()
        sync = self._services.sync_producer.expire(now)
        if sync is not None:
            self._synchronise(sync.data, now, sync)
        for rpdo in self._services.rpdos:
            rpdo.expire(now)
        is_heartbeat_lost = self._services.consumer.expire(now)
        if self._services.guarding.expire(now) or is_heartbeat_lost:
            self.follow_error_behaviour(COMMUNICATION_ERROR)

    def follow_error_behaviour(self, subindex: int) -> None:
        """Do as 0x1029 says after an error of the class `subindex`.

        The node sees to communication errors (sub-index 1) itself; the other classes are those of
        the device profile, and the application calls this.
        """
        state = self._services.error_behaviour.state_after(subindex, self.state)
        if state is not None:
            self._enter(state)

    def trigger_tpdo(self, number: int) -> None:
        """Take an application event for TPDO `number` (types 0, 254, 255)."""
        self._tpdos.trigger(number)

    def settle_pdos(self, now: int, emit: Emit) -> None:
        """Send the TPDOs that a SYNC of this round has asked for, since another one has come.

        The node sees to it by itself; who runs several nodes calls this for all of them first, so
        that their PDOs of one SYNC come before those of the next.
        """
        if not self._tpdos.due and not self._is_silent:
            self._tpdos.settle(now, emit)

    def transmit_pdos(self, now: int, emit: Emit) -> None:
        """Send the TPDOs that are due, with the objects' present values."""
        if now >= self._tpdos.due and not self._is_silent:
            self._tpdos.transmit(now, emit)

    def serve(self, now: int, emit: Emit) -> None:
        """Send boot-up, SDO and LSS answers, EMCY and error control, as far as they are due."""
        if now < self._agenda.due or not self._is_started:
            return
        services, rest = self._services, self._rest
        if self._is_silent:
            self._agenda.due = rest.due = services.lss.silent_until
            return
        if now < rest.due:
            services.sdo.serve(now, emit)
        if now >= rest.due:  # or is by now: what was written may ask for more
            if self.state is NmtState.INITIALISING and self.node_id != UNCONFIGURED:
                self._boot(now, emit)
            rest.due = services.serve(now, emit, self.state)
        due = services.sdo.agenda.due
        if rest.due < due:  # noqa: PLR1730 - min() costs more than all the rest here
            due = rest.due
        self._agenda.due = due

    def _watch_identifiers(self) -> None:
        for variable in self.object_dictionary:
            if names_identifier(variable):
                variable.add_hook(self._follow_identifier)

    def _follow_identifier(self, _cob_id: int) -> None:
        self._update_routes()
        self._rest.bring_forward(0)

    def _update_routes(self) -> None:
        table = RouteTable()
        if self._services.lss.is_available and not self._is_silent:
            table.add(LSS_REQUEST, self._receive_lss)
        if self.node_id != UNCONFIGURED and not self._is_silent:
            self._add_routes(table)
        self.routes = table.routes

    def _add_routes(self, table: RouteTable) -> None:
        for can_id in self._tpdos.can_ids:
            table.add(can_id, self._tpdos.receive)
        table.add(ERROR_CONTROL + self.node_id, self._receive_guarding)
        for node_id in self._services.consumer.node_ids:
            table.add(ERROR_CONTROL + node_id, self._receive_heartbeat)
        for rpdo in self._services.rpdos:
            table.add(rpdo.can_id, rpdo.receive)
        for can_id, handler in self._services.sdo.handlers.items():
            table.add(can_id, handler)
        table.add(self._services.time.can_id, self._services.time.receive)
        table.add(self._services.sync.can_id, self._receive_sync)
        table.add(NMT_COB_ID, self._receive_nmt)

    def _receive_lss(self, frame: Frame, now: int) -> None:
        self._services.lss.receive(frame, now)
        if self._services.lss.must_boot:
            self._reset(NmtCommand.RESET_COMMUNICATION)
        elif now < self._services.lss.silent_until:
            self._is_silent = True
            self._update_routes()
            self._rest.bring_forward(now)

    def _receive_guarding(self, frame: Frame, now: int) -> None:
        """Take a frame with our own error control identifier: the master's request, or a stray."""
        is_request = frame.is_remote and not frame.is_extended
        is_up = self.state is not NmtState.INITIALISING
        if not (is_request and is_up and self._services.guarding.receive(now)):
            self.counters.is_data(frame)

    def _receive_nmt(self, frame: Frame, _now: int) -> None:
        if not self.counters.is_data(frame):
            return
        request = NmtRequest.parse(frame.data)
        if request is None:
            self.counters.malformed_nmt += 1
        elif request.addresses(self.node_id) and self.state is not NmtState.INITIALISING:
            self._obey(request.command)

    def _receive_sync(self, frame: Frame, now: int) -> None:
        _, data, is_remote, is_extended, _ = frame
        if is_remote or is_extended:
            self.counters.ignored_frames += 1
        elif self.state in COMMUNICATING and not self._services.sync_producer.is_producing:
            self._synchronise(data, now)

    def _synchronise(self, data: bytes, now: int, own: Frame | None = None) -> None:
        """Act on a SYNC; `own` is the frame where this node produces it.

        PDOs that still wait for their turn since the last SYNC keep the values that they had then.
        """
        if not self._tpdos.due:
            self._tpdos.settle(now)
        counter = self._services.sync.receive(data, now)
        for rpdo in self._services.rpdos:
            rpdo.synchronise()
        self._tpdos.synchronise(counter, own)

    def _receive_heartbeat(self, frame: Frame, now: int) -> None:
        if not self.counters.is_data(frame) or self.state is NmtState.INITIALISING:
            return
        if self._services.consumer.receive(frame, now):
            self.follow_error_behaviour(COMMUNICATION_ERROR)

    def _obey(self, command: NmtCommand) -> None:
        if command in RESTORED:
            self._reset(command)
        else:
            self._enter(ENTERED[command])

    def _reset(self, command: NmtCommand) -> None:
        restored = RESTORED[command]
        self._enter(NmtState.INITIALISING)
        self._services.reset(restored)
        self.node_id = self._services.node_id
        self._update_routes()
        self._rest.bring_forward(0)
        is_whole = command is NmtCommand.RESET_NODE
        kind = NodeEventKind.RESET_NODE if is_whole else NodeEventKind.RESET_COMMUNICATION
        self.events.tell(NodeEvent(kind, 0))

    def _boot(self, now: int, emit: Emit) -> None:
        self._services.producer.boot_up(now, emit)
        self._enter(NmtState.PRE_OPERATIONAL)
        if self._services.startup.is_automatic:
            self._enter(NmtState.OPERATIONAL)

    def _enter(self, state: NmtState) -> None:
        if state is self.state:
            return
        self.state = state
        self._services.set_state(state)
        self._rest.bring_forward(0)
        self.events.tell(NodeEvent(NodeEventKind.STATE_CHANGED, state))
