"""SDO server parameters 0x1200 to 0x127F (CiA 301): the channels of a node, each by itself."""

from collections.abc import Iterator
from functools import partial
from typing import Any, Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.agenda import NEVER, Agenda
from hil_bench.canopen_device.cob_id import DISABLED, can_id, check_change
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.frame import Emit, Frame, Handler
from hil_bench.canopen_device.nmt import COMMUNICATING, NmtState
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.sdo import SdoServer
from hil_bench.canopen_device.service import NodeCounters, Service

REQUEST: Final = 0x600
"""Identifier of the default channel, client to server, plus the node-ID."""
RESPONSE: Final = 0x580
"""Identifier of the default channel, server to client, plus the node-ID."""

_DEFAULT: Final = 0x1200
_FURTHER: Final = range(0x1201, 0x1280)
_REQUEST_SUBINDEX: Final = 1
_RESPONSE_SUBINDEX: Final = 2


class SdoChannels(Service):
    """The default channel, which every node has, and those of 0x1201 and following.

    A further channel is open while both of its identifiers are valid (bit 31 clear). Its
    identifiers change as every COB-ID does: not while the object exists. Those of the default
    channel follow from the node-ID and never change. A channel does not wait for another one, and
    a transfer on one does not touch that of another.

    Attributes:
        agenda: when a request waits, or a transfer is to go on or times out. An answer that is
            ready does not count: it only brings the agenda of the whole node forward.
    """

    def __init__(
        self,
        object_dictionary: ObjectDictionary,
        node_id: int,
        agenda: Agenda,
        counters: NodeCounters,
    ) -> None:
        self._object_dictionary = object_dictionary
        self.agenda = Agenda(agenda)
        self._answers: list[Frame] = []
        parts = (object_dictionary, self.agenda, agenda, self._answers, counters)
        self._default = SdoServer(*parts)
        self._further = {index: SdoServer(*parts) for index in object_dictionary.indices(_FURTHER)}
        self._servers = (self._default, *self._further.values())
        self._open: tuple[SdoServer, ...] = ()
        self._watch_parameters()
        self.reset(node_id)

    def handlers(self) -> Iterator[tuple[int | None, Handler]]:
        """Yield the channels' handlers of requests."""
        for server in self._servers:
            yield server.request_id, server.receive

    @property
    def response_ids(self) -> list[int]:
        """The identifiers of its answers."""
        return [server.response_id for server in self._open]

    def enter(self, state: NmtState) -> None:
        """Begin to serve, or end all transfers without a word."""
        is_enabled = state in COMMUNICATING
        for server in self._servers:
            server.is_enabled = is_enabled
            if not is_enabled:
                server.reset()
        if not is_enabled:
            self._answers.clear()

    def reset(self, node_id: int) -> None:
        """Begin anew, for the device `node_id`, after the parameters got their defaults."""
        self._default.request_id = REQUEST + node_id
        self._default.response_id = RESPONSE + node_id
        self._default.reset()
        self._collect_open()
        for index in self._further:
            self._configure(index)

    def serve(self, now: int, emit: Emit) -> int:
        """Send the answer that is ready, then answer what was asked, channel by channel."""
        if self._answers:
            emit(self._answers.pop())
        if now < self.agenda.due:
            return NEVER
        due = NEVER
        for server in self._open:
            due = min(due, server.serve(now, emit))
        self.agenda.due = due
        return NEVER

    def _configure(self, index: int, _value: Any = None) -> None:  # noqa: ANN401 - it is a hook
        server = self._further[index]
        request_id, response_id = self._can_id(index, 1), self._can_id(index, 2)
        is_open = request_id is not None and response_id is not None
        server.request_id = request_id if is_open else None
        server.response_id = response_id or 0
        server.reset()
        self._collect_open()

    def _collect_open(self) -> None:
        self._open = tuple(server for server in self._servers if server.request_id is not None)

    def _can_id(self, index: int, subindex: int) -> int | None:
        return can_id(self._object_dictionary.number(index, subindex, absent=DISABLED))

    def _watch_parameters(self) -> None:
        for index in (_DEFAULT, *self._further):
            for subindex in (_REQUEST_SUBINDEX, _RESPONSE_SUBINDEX):
                variable = self._object_dictionary.find(index, subindex)
                if variable is None:
                    continue
                if index == _DEFAULT:
                    variable.add_check(_refuse)
                else:
                    variable.add_check(partial(check_change, variable))
                    variable.add_hook(partial(self._configure, index))


def _refuse(_cob_id: int) -> None:
    """Refuse to change the default channel, which an EDS may wrongly declare as writable.

    Raises:
        SdoAbort: 0601 0002.
    """
    raise SdoAbort(*abort_codes.READ_ONLY)
