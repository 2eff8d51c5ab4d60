"""Node guarding and life guarding (CiA 301, error control): 0x100C, 0x100D.

The NMT master asks with a remote frame; the answer is the NMT state, with a toggle bit that is 0 in
the first answer after boot-up. Once asked, the device expects to be asked again within the life
time, 0x100C ms times 0x100D; if it is not, that is a life guarding event.

Heartbeat excludes guarding: while 0x1017 is not 0, remote requests get no answer. The same holds
for a device without 0x100C.
"""

from typing import Final

from hil_bench.canopen_device.agenda import MILLISECOND, NEVER, Agenda
from hil_bench.canopen_device.emcy import COMMUNICATION, HEARTBEAT, EmcyProducer
from hil_bench.canopen_device.events import NodeEvent, NodeEventKind, NodeEvents
from hil_bench.canopen_device.frame import Emit, Frame
from hil_bench.canopen_device.heartbeat import ERROR_CONTROL
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.canopen_device.object_dictionary import ObjectDictionary

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
