"""Error control (CiA 301): boot-up message, heartbeat and guarding of one node."""

from collections.abc import Iterator

from hil_bench.canopen_device.agenda import Agenda
from hil_bench.canopen_device.counters import NodeCounters
from hil_bench.canopen_device.emcy import EmcyProducer
from hil_bench.canopen_device.events import NodeEvents
from hil_bench.canopen_device.frame import Emit, Frame, Handler
from hil_bench.canopen_device.guarding import NodeGuarding
from hil_bench.canopen_device.heartbeat import (
    ERROR_CONTROL,
    HeartbeatConsumer,
    HeartbeatProducer,
)
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.service import Service


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
