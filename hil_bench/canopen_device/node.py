"""A CANopen node: the services of CiA 301 and CiA 305 around one object dictionary, sans I/O.

Frames and the time go in, frames come out through `emit`. One round of a node::

    node.receive(frame, now)      for each frame: NMT, SYNC and RPDO act at once, SDO waits
    node.expire(now)              what did not come in time, and the SYNC that is due
    ...                           the application drains `node.events`, reads and sets objects
    node.transmit_pdos(now, emit)
    node.serve(now, emit)         boot-up, SDO answers, EMCY, heartbeat

`expire` and `serve` have nothing to do before `node.deadline`.
"""

from collections.abc import Callable, Collection, Iterable
from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.agenda import NEVER, Agenda
from hil_bench.canopen_device.emcy import CanErrors, CanEvent, EmcyProducer
from hil_bench.canopen_device.error_control import (
    COMMUNICATION_ERROR,
    ERROR_CONTROL,
    ErrorBehaviour,
    ErrorControl,
)
from hil_bench.canopen_device.errors import ConfigError, SdoAbort
from hil_bench.canopen_device.events import NodeEvent, NodeEventKind, NodeEvents
from hil_bench.canopen_device.frame import Emit, Frame, Routes
from hil_bench.canopen_device.lss import LSS_REQUEST, LssSlave
from hil_bench.canopen_device.nmt import (
    ENTERED,
    NMT_COB_ID,
    RESTORED,
    UNCONFIGURED,
    NmtCommand,
    NmtRequest,
    NmtState,
)
from hil_bench.canopen_device.object_dictionary import Access, ObjectDictionary
from hil_bench.canopen_device.pdo_parameters import MOST_BYTES, limit_mapping, mapped_bytes
from hil_bench.canopen_device.process_data import ProcessData
from hil_bench.canopen_device.sdo import SdoChannels
from hil_bench.canopen_device.service import (
    AddedService,
    NodeCounters,
    RouteTable,
    names_identifier,
)
from hil_bench.canopen_device.storage import MemoryStorage, ParameterStore, Storage
from hil_bench.canopen_device.sync import TimeConsumer, TimeOfDay

ServiceMaker = Callable[[ObjectDictionary, int, Agenda, NodeEvents, EmcyProducer], AddedService]
"""Makes a service of the objects and the node-ID of a node, once these have their first values."""

# NMT startup 0x1F80 (CiA 302-2), as far as it concerns a device that is no NMT master.

_NMT_STARTUP: Final = 0x1F80
_NO_SELF_START: Final = 1 << 2
"""The device stays in PRE-OPERATIONAL after boot-up until the NMT master starts it."""
_NO_START_OF_OTHERS: Final = 1 << 3
"""Says what an NMT master does not do, so it is true of every other device."""


class Startup:
    """Knows whether the device enters OPERATIONAL by itself; without 0x1F80 it does not."""

    def __init__(self, object_dictionary: ObjectDictionary) -> None:
        self._startup = object_dictionary.find(_NMT_STARTUP)
        if self._startup is not None:
            self._startup.add_check(_check)

    @property
    def is_automatic(self) -> bool:
        """True if OPERATIONAL follows the boot-up at once."""
        return self._startup is not None and not self._startup.value & _NO_SELF_START


def _check(startup: int) -> None:
    """Refuse what would make this device an NMT master.

    Raises:
        SdoAbort: 0609 0030.
    """
    if startup & ~(_NO_SELF_START | _NO_START_OF_OTHERS):
        raise SdoAbort(*abort_codes.VALUE)


# Verify configuration 0x1020 (CiA 301): does the device have what a master has written last?
#
# A master writes date and time of its configuration into sub-index 1 and 2, and reads them at the
# next boot-up (CiA 302-2). Any later change of the configuration sets both to 0; a master that
# finds another date writes everything again.

_VERIFY_CONFIGURATION: Final = 0x1020
_DATE_AND_TIME: Final = (1, 2)
_NO_CONFIGURATION: Final = frozenset({0x1003, 0x1010, 0x1011, 0x1013, _VERIFY_CONFIGURATION})
_WRITABLE: Final = frozenset({Access.RW, Access.RWR})


def watch_configuration(object_dictionary: ObjectDictionary) -> None:
    """Let each change of the configuration of a device clear its 0x1020, where it has one.

    What an RPDO may write is no configuration.
    """
    found = [object_dictionary.find(_VERIFY_CONFIGURATION, subindex) for subindex in _DATE_AND_TIME]
    stamps = [variable for variable in found if variable is not None]
    if not stamps:
        return

    def clear(_value: object) -> None:
        for stamp in stamps:
            stamp.value = 0

    for variable in object_dictionary:
        if variable.access in _WRITABLE and variable.index not in _NO_CONFIGURATION:
            variable.add_hook(clear)


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
        added: Iterable[ServiceMaker] = (),
    ) -> None:
        """Compose the services; the node is silent until `start`.

        Args:
            object_dictionary: its objects, with the defaults of `node_id`.
            node_id: 1 to 127, or 255 for none; a node-ID that LSS stored takes its place.
            storage: its non-volatile memory; without it, what is stored lives as long as the node.
            agenda: one that several nodes share, which each of them brings forward with its own.
            added: makers of services that not every device has.

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
        self._rest = Agenda(self._agenda)  # of all but SDO, whose requests wake a node most often
        self._is_started = False
        self._is_silent = False
        self.emcy = EmcyProducer(object_dictionary, self._rest, self.counters)
        self._can_errors = CanErrors(self.emcy)
        self._store = ParameterStore(object_dictionary, storage or MemoryStorage(), self.emcy)
        self._take_node_id(self._store.node_id or node_id)
        self._power_up(RESTORED[NmtCommand.RESET_NODE])
        self._compose(added)
        if self.node_id == UNCONFIGURED and not self._lss.is_available:
            raise ConfigError(
                f"{object_dictionary.source}: a node without node-ID needs the objects 0x1018.01 "
                "to 0x1018.04, which LSS finds it by"
            )
        for variable in object_dictionary:
            if names_identifier(variable):
                variable.add_hook(self._follow_identifier)
        watch_configuration(object_dictionary)
        self._update_routes()

    @property
    def state_name(self) -> str:
        """Its NMT state as people read it, or OFF."""
        return self.state.name.replace("_", "-") if self.has_power else "OFF"

    @property
    def errors(self) -> frozenset[int]:
        """The codes of the errors that it has; without power it knows of no error."""
        return self.emcy.present if self.has_power else frozenset()

    @property
    def deadline(self) -> int:
        """The next time at which `expire` or `serve` has something to do [ns]."""
        return self._agenda.due

    @property
    def has_power(self) -> bool:
        """Return True from `start` to `switch_off`."""
        return self._is_started

    @property
    def sync_id(self) -> int | None:
        """Identifier of SYNC, None where the device knows none."""
        return self._process_data.sync.can_id

    @property
    def sdo_ids(self) -> Collection[int]:
        """Identifiers of the requests that this node's SDO servers take."""
        return [can_id for can_id, _ in self._sdo.handlers() if can_id is not None]

    @property
    def sent_ids(self) -> frozenset[int]:
        """Identifiers that this node sends with, and no other device should."""
        if self.node_id == UNCONFIGURED:
            return frozenset()
        others = {ERROR_CONTROL + self.node_id, self.emcy.can_id, *self._sdo.response_ids}
        return self._tpdos.can_ids.union(can_id for can_id in others if can_id is not None)

    @property
    def syncs(self) -> int:
        """The number of SYNCs received."""
        return self._process_data.sync.received

    @property
    def storage_problem(self) -> str | None:
        """Why parameters are not used or not stored, for people; None where all is well."""
        return self._store.unwritten or self._store.problem

    def time_of_day(self, now: int) -> TimeOfDay | None:
        """Return the time of day at `now` [ns] by the last TIME message, None before the first."""
        return self._time.time_of_day(now)

    def start(self, now: int) -> None:
        """Power on: the next `serve` sends the boot-up message and enters PRE-OPERATIONAL.

        Where 0x1F80 is there and has bit 2 clear, OPERATIONAL follows at once (CiA 302-2). A node
        without node-ID stays silent until LSS gives it one.
        """
        self._is_started = True
        self._rest.bring_forward(now)

    def switch_off(self) -> None:
        """Power off: forget what is not stored, and say nothing until `start`."""
        self._reset(NmtCommand.RESET_NODE)
        self._is_started = False

    def receive(self, frame: Frame, now: int) -> None:
        """Take a frame from the bus: NMT, SYNC, RPDO act at once; SDO requests are queued."""
        handler = self.routes.get(frame.can_id)
        if handler is not None:
            handler(frame, now)

    def expire(self, now: int) -> None:
        """Act on what did not come in time, and produce SYNC where this node does that."""
        if now < self._rest.due:
            return
        if self._is_silent and now >= self._lss.silent_until:
            self._is_silent = False
            self._update_routes()
        self._process_data.expire(now)
        for service in self._added:
            service.expire(now)
        if self._error_control.expire(now):
            self.follow_error_behaviour(COMMUNICATION_ERROR)

    def follow_error_behaviour(self, subindex: int) -> None:
        """Do as 0x1029 says after an error of the class `subindex`.

        The node sees to communication errors (sub-index 1) itself; the other classes are those of
        the device profile, and the application calls this.
        """
        state = self._error_behaviour.state_after(subindex, self.state)
        if state is not None:
            self._enter(state)

    def take_can_event(self, event: CanEvent) -> None:
        """Act on what the CAN controller tells: EMCY, and 0x1029 when it is bus-off."""
        self._can_errors.take(event)
        if event is CanEvent.BUS_OFF:
            self.follow_error_behaviour(COMMUNICATION_ERROR)

    def protect_tpdo(self, number: int) -> None:
        """Send TPDO `number` with a rolling counter and a checksum; see `pdo_protection`.

        Raises:
            ValueError: there is no such TPDO, or it maps too much to have room for them.
        """
        if mapped_bytes(self.object_dictionary, number) > MOST_BYTES:
            raise ValueError(f"TPDO {number} maps more than {MOST_BYTES} bytes")
        if not self._tpdos.protect(number):
            raise ValueError(f"there is no TPDO {number}")
        limit_mapping(self.object_dictionary, number)

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
        rest, sdo = self._rest, self._sdo
        if self._is_silent:
            self._agenda.due = rest.due = self._lss.silent_until
            return
        if now < rest.due:
            sdo.serve(now, emit)
        if now >= rest.due:  # or is by now: what was written may ask for more
            if self.state is NmtState.INITIALISING and self.node_id != UNCONFIGURED:
                self._boot(now, emit)
            rest.due = NEVER
            rest.bring_forward(min(service.serve(now, emit) for service in self._services))
        due = sdo.agenda.due
        if rest.due < due:  # noqa: PLR1730 - min() costs more than all the rest here
            due = rest.due
        self._agenda.due = due

    def _compose(self, added: Iterable[ServiceMaker]) -> None:
        """Make the services, which read objects that have their power-on values."""
        dictionary, rest, emcy = self.object_dictionary, self._rest, self.emcy
        events, counters = self.events, self.counters
        self._startup = Startup(dictionary)
        self._error_behaviour = ErrorBehaviour(dictionary)
        self._lss = LssSlave(dictionary, self.node_id, self._store, rest, counters)
        self._sdo = SdoChannels(dictionary, self.node_id, self._agenda, counters)
        self._time = TimeConsumer(dictionary, counters)
        self._error_control = ErrorControl(dictionary, self.node_id, rest, events, emcy, counters)
        self._process_data = ProcessData(dictionary, rest, events, emcy, counters)
        self._tpdos = self._process_data.tpdos
        self._added = tuple(make(dictionary, self.node_id, rest, events, emcy) for make in added)
        self._services = (  # in the order in which they send
            self._lss,
            self._sdo,
            emcy,
            self._error_control,
            self._process_data,
            *self._added,
            self._time,
            self._store,
        )

    def _follow_identifier(self, _cob_id: int) -> None:
        self._update_routes()
        self._rest.bring_forward(0)

    def _update_routes(self) -> None:
        table = RouteTable()
        if self._lss.is_available and not self._is_silent:
            table.add(LSS_REQUEST, self._receive_lss)
        if self.node_id != UNCONFIGURED and not self._is_silent:
            self._add_routes(table)
        self.routes = table.routes

    def _add_routes(self, table: RouteTable) -> None:
        for service in self._services:
            for can_id, handler in service.handlers():
                table.add(can_id, handler)
        for can_id in self._error_control.heartbeat_ids:
            table.add(can_id, self._receive_heartbeat)
        table.add(NMT_COB_ID, self._receive_nmt)

    def _receive_lss(self, frame: Frame, now: int) -> None:
        self._lss.receive(frame, now)
        if self._lss.must_boot:
            self._reset(NmtCommand.RESET_COMMUNICATION)
        elif now < self._lss.silent_until:
            self._is_silent = True
            self._update_routes()
            self._rest.bring_forward(now)

    def _receive_nmt(self, frame: Frame, _now: int) -> None:
        if not self.counters.is_data(frame):
            return
        request = NmtRequest.parse(frame.data)
        if request is None:
            self.counters.malformed_nmt += 1
        elif request.addresses(self.node_id) and self.state is not NmtState.INITIALISING:
            self._obey(request.command)

    def _receive_heartbeat(self, frame: Frame, now: int) -> None:
        if self._error_control.receive_heartbeat(frame, now):
            self.follow_error_behaviour(COMMUNICATION_ERROR)

    def _obey(self, command: NmtCommand) -> None:
        if command in RESTORED:
            self._reset(command)
        else:
            self._enter(ENTERED[command])

    def _reset(self, command: NmtCommand) -> None:
        restored = RESTORED[command]
        self._enter(NmtState.INITIALISING)
        self._take_node_id(self._lss.pending_node_id)
        self._power_up(restored)
        for service in self._services:
            service.reset(self.node_id)
        self._update_routes()
        self._rest.bring_forward(0)
        is_whole = command is NmtCommand.RESET_NODE
        kind = NodeEventKind.RESET_NODE if is_whole else NodeEventKind.RESET_COMMUNICATION
        self.events.tell(NodeEvent(kind, 0))

    def _take_node_id(self, node_id: int) -> None:
        self.node_id = node_id
        if node_id != UNCONFIGURED:
            self.object_dictionary.assign_node_id(node_id)

    def _power_up(self, restored: range) -> None:
        """Set the objects `restored` to their power-on values; say so where these are damaged."""
        self._store.restore(restored)
        self.emcy.forget(restored)
        self._store.report()

    def _boot(self, now: int, emit: Emit) -> None:
        self._error_control.boot_up(now, emit)
        self._enter(NmtState.PRE_OPERATIONAL)
        if self._startup.is_automatic:
            self._enter(NmtState.OPERATIONAL)

    def _enter(self, state: NmtState) -> None:
        if state is self.state:
            return
        self.state = state
        for service in self._services:
            service.enter(state)
        self._rest.bring_forward(0)
        self.events.tell(NodeEvent(NodeEventKind.STATE_CHANGED, state))
