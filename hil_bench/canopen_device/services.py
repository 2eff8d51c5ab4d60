"""The services of one node, composed and kept in step with its NMT state and node-ID."""

from typing import Final

from hil_bench.canopen_device.agenda import NEVER, Agenda, Timed
from hil_bench.canopen_device.counters import NodeCounters
from hil_bench.canopen_device.emcy import EmcyProducer
from hil_bench.canopen_device.error_behaviour import ErrorBehaviour
from hil_bench.canopen_device.events import NodeEvents
from hil_bench.canopen_device.frame import Emit
from hil_bench.canopen_device.guarding import NodeGuarding
from hil_bench.canopen_device.heartbeat import HeartbeatConsumer, HeartbeatProducer
from hil_bench.canopen_device.lss import LssSlave
from hil_bench.canopen_device.nmt import RESTORED, UNCONFIGURED, NmtCommand, NmtState
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.parameter_store import ParameterStore
from hil_bench.canopen_device.pdo_mapping import Direction
from hil_bench.canopen_device.pdo_parameters import COMMUNICATION_INDICES, PdoParameters
from hil_bench.canopen_device.rpdo import Rpdo
from hil_bench.canopen_device.sdo_channels import SdoChannels
from hil_bench.canopen_device.startup import Startup
from hil_bench.canopen_device.storage import Storage
from hil_bench.canopen_device.sync import SyncConsumer, SynchronousWindow, SyncProducer
from hil_bench.canopen_device.time_stamp import TimeConsumer
from hil_bench.canopen_device.tpdo import TpdoProducer

COMMUNICATING: Final = frozenset({NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL})
"""The NMT states that have SDO, SYNC, TIME and EMCY."""

_EVERYTHING: Final = RESTORED[NmtCommand.RESET_NODE]


class Services:
    """Every service of a node, over its one object dictionary.

    Attributes:
        node_id: the node-ID in force, 255 for none.
        agenda: of all but SDO, whose requests are most of what wakes a node.
    """

    def __init__(
        self,
        object_dictionary: ObjectDictionary,
        node_id: int,
        storage: Storage,
        agenda: Agenda,
        events: NodeEvents,
        counters: NodeCounters,
    ) -> None:
        """Set every object to its power-on value, then compose the services that read them."""
        self.node_id = node_id
        self.agenda = Agenda(agenda)
        self._object_dictionary = object_dictionary
        self.emcy = EmcyProducer(object_dictionary, self.agenda, counters)
        self.store = ParameterStore(object_dictionary, storage, self.emcy)
        self._take_node_id(self.store.node_id or node_id)
        self.store.restore(_EVERYTHING)
        self.emcy.reset(_EVERYTHING)
        self.store.report()
        self.sdo = SdoChannels(object_dictionary, self.node_id, agenda, counters)
        self._compose(events, counters)

    def serve(self, now: int, emit: Emit, state: NmtState) -> int:
        """Send what is due; return the earliest time at which a service wants to be called [ns].

        In the order LSS, SDO, EMCY, error control. The time leaves out SDO, which tells its own.
        """
        self.lss.serve(emit)
        self.sdo.serve(now, emit)
        self.emcy.serve(now, emit)
        self.guarding.serve(emit, state)
        self.producer.serve(now, emit, state)
        due = NEVER
        for service in self._timed:
            if service.due < due:  # noqa: PLR1730 - min() costs more than all the rest here
                due = service.due
        return due

    def set_state(self, state: NmtState) -> None:
        """Switch the services on that the NMT state has, and the others off."""
        is_operational = state is NmtState.OPERATIONAL
        is_communicating = state in COMMUNICATING
        for rpdo in self.rpdos:
            rpdo.set_operational(is_operational=is_operational)
        self.tpdos.set_operational(is_operational=is_operational)
        self.sync_producer.set_enabled(is_enabled=is_communicating)
        self.sdo.set_enabled(is_enabled=is_communicating)
        self.time.is_enabled = self.emcy.is_enabled = is_communicating
        self.store.is_enabled = not is_operational

    def reset(self, restored: range) -> None:
        """Begin anew, the objects `restored` at their power-on values, with LSS's node-ID."""
        self._take_node_id(self.lss.pending_node_id)
        self.store.restore(restored)
        self.emcy.reset(restored)
        self.store.report()
        self.lss.reset(self.node_id)
        self.sync.reset()
        self.time.reset()
        self.sdo.reset(self.node_id)
        self.producer.reset(self.node_id)
        self.consumer.reset()
        self.guarding.reset(self.node_id)
        for rpdo in self.rpdos:
            rpdo.reset()
        self.tpdos.reset()

    def _take_node_id(self, node_id: int) -> None:
        self.node_id = node_id
        if node_id != UNCONFIGURED:
            self._object_dictionary.assign_node_id(node_id)

    def _compose(self, events: NodeEvents, counters: NodeCounters) -> None:
        dictionary, node_id, emcy = self._object_dictionary, self.node_id, self.emcy
        agenda = self.agenda
        window = SynchronousWindow()
        self.startup = Startup(dictionary)
        self.error_behaviour = ErrorBehaviour(dictionary)
        self.lss = LssSlave(dictionary, node_id, self.store, agenda, counters)
        self.sync = SyncConsumer(dictionary, window, emcy, counters)
        self.sync_producer = SyncProducer(dictionary, agenda)
        self.time = TimeConsumer(dictionary, counters)
        self.producer = HeartbeatProducer(dictionary, node_id, agenda)
        self.consumer = HeartbeatConsumer(dictionary, agenda, events, emcy, counters)
        self.guarding = NodeGuarding(dictionary, node_id, agenda, events, emcy)
        self.rpdos = tuple(
            Rpdo(
                PdoParameters(dictionary, index, Direction.RPDO),
                *(agenda, window, events, emcy, counters),
            )
            for index in dictionary.indices(COMMUNICATION_INDICES[Direction.RPDO])
        )
        self.tpdos = TpdoProducer(dictionary, window, counters)
        self._timed: list[Timed] = [self.lss, emcy, self.producer]
        self._timed += [self.sync_producer, self.consumer, self.guarding, *self.rpdos]
