"""SDO servers: the protocol of one, and the channels of a node."""

import struct
from collections import deque
from collections.abc import Iterator
from functools import partial
from typing import Any, Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.agenda import NEVER, Agenda
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.frame import (
    DISABLED,
    Emit,
    Frame,
    Handler,
    can_id,
    check_change,
    make_frame,
)
from hil_bench.canopen_device.nmt import COMMUNICATING, NmtState
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.sdo_block import BLOCK_SIZE, BlockDownload, BlockUpload
from hil_bench.canopen_device.sdo_transfer import (
    Multiplexer,
    SegmentedDownload,
    SegmentedUpload,
    Transfer,
    check_bound,
)
from hil_bench.canopen_device.service import NodeCounters, Service

# SDO server (CiA 301, service data objects): one channel, all transfers.
#
# Requests wait in a bounded queue and are answered in order by `serve`. The quick way is that of
# most segments, of which no object hears: these are taken, and their answers made, with the
# reception; `serve` of the channels sends them. Each request gets one answer, but for an abort from
# the client, a segment of a block download, a frame of fewer than 8 bytes, and a request outside
# the NMT states that have SDO: these get none.
#
# Command specifiers of requests (CiA 301): 1 initiate download, 0 download segment, 2 initiate
# upload, 3 upload segment, 4 abort, 5 block upload, 6 block download. 7 aborts with 0504 0001.


BUFFER_SIZE: Final = 65536
"""Longest string or domain that a client may download [byte], unless the object says otherwise."""
QUEUE_LENGTH: Final = 256
"""Requests that may wait; more than a bus brings in 30 ms."""

_INITIATE_DOWNLOAD: Final = 1
_INITIATE_UPLOAD: Final = 2
_ABORT: Final = 4
_BLOCK_UPLOAD: Final = 5
_BLOCK_DOWNLOAD: Final = 6
_SEGMENTS: Final = frozenset({0, 3})

_EXPEDITED: Final = 0x02
_SIZE_INDICATED: Final = 0x01
_BLOCK_CRC: Final = 0x04
_BLOCK_SIZE_INDICATED: Final = 0x02

_SHORT: Final = struct.Struct("<BHB4s")
_LONG: Final = struct.Struct("<BHBI")

_NO_OBJECT: Final[Multiplexer] = (0, 0)


class SdoServer:
    """One SDO channel of a node.

    Attributes:
        request_id: identifier from client to server, None while the channel is closed.
        response_id: identifier from server to client.
        is_enabled: whether the NMT state allows SDO.
    """

    def __init__(
        self,
        object_dictionary: ObjectDictionary,
        agenda: Agenda,
        node_agenda: Agenda,
        answers: list[Frame],
        counters: NodeCounters,
    ) -> None:
        """Begin as a closed channel.

        Args:
            object_dictionary: what clients read and write.
            agenda: brought forward when `serve` has something to do.
            node_agenda: brought forward when an answer is ready.
            answers: where an answer goes that is ready when its request comes, one at most. It is
                sent before those that `serve` finds.
            counters: what was ignored or refused.
        """
        self.request_id: int | None = None
        self.response_id = 0
        self.is_enabled = False
        self._object_dictionary = object_dictionary
        self._agenda = agenda
        self._node_agenda = node_agenda
        self._answers = answers
        self._counters = counters
        self._queue: deque[bytes] = deque()
        self._transfer: Transfer | None = None

    def receive(self, frame: Frame, now: int) -> None:
        """Answer a request in the midst of a transfer; queue any other one."""
        request, transfer, answer = frame.data, self._transfer, None
        # A remote frame has no data. What waits goes first.
        if (
            transfer is not None
            and not (self._queue or self._answers)
            and len(request) == 8
            and not frame.is_extended
        ):
            answer = transfer.absorb(request, now)
        if answer is None:
            self._enqueue(frame)
        elif answer:
            self._answers.append(make_frame(Frame, (self.response_id, answer, False, False, 0, 0)))
            self._node_agenda.bring_forward(0)

    def reset(self) -> None:
        """Forget all requests and the transfer under way, without an answer."""
        self._queue.clear()
        self._transfer = None

    def serve(self, now: int, emit: Emit) -> int:
        """Answer what was asked; go on with a block upload, or abort what has timed out.

        Returns:
            When the transfer under way is to go on, or times out [ns].
        """
        response_id = self.response_id  # of old, where a request changes it
        while self._queue:
            answer = self._answer(self._queue.popleft(), now)
            if answer is not None:
                emit(make_frame(Frame, (response_id, answer, False, False, 0, 0)))
        transfer = self._transfer
        if transfer is None:
            return NEVER
        if now >= transfer.due:
            self._proceed(transfer, now, emit)
        return transfer.due if self._transfer is transfer else NEVER

    def _enqueue(self, frame: Frame) -> None:
        _, request, is_remote, is_extended, _, _ = frame
        if is_remote or is_extended:
            self._counters.ignored_frames += 1
        elif not self.is_enabled:
            return
        elif len(request) < 8:
            self._counters.short_sdo_requests += 1
        elif len(self._queue) >= QUEUE_LENGTH:
            self._counters.dropped_sdo_requests += 1
        else:
            self._queue.append(request)
            self._agenda.bring_forward(0)

    def _proceed(self, transfer: Transfer, now: int, emit: Emit) -> None:
        response_id = self.response_id
        try:
            for data in transfer.proceed(now):
                emit(make_frame(Frame, (response_id, data, False, False, 0, 0)))
        except SdoAbort as abort:
            emit(Frame(response_id, self._abort(transfer.target, abort.code)))

    def _answer(self, request: bytes, now: int) -> bytes | None:
        command, transfer = request[0], self._transfer
        if transfer is not None and transfer.owns(command):
            return self._continue(transfer, request, now)
        specifier = command >> 5
        self._transfer = None
        if specifier == _ABORT:
            return None
        try:
            return self._begin(specifier, command, request, now)
        except SdoAbort as abort:
            target = _parse_object(request)
            if _names_no_object(command):
                target = _NO_OBJECT if transfer is None else transfer.target
            return self._abort(target, abort.code)

    def _continue(self, transfer: Transfer, request: bytes, now: int) -> bytes | None:
        try:
            answer = transfer.take(request, now)
        except SdoAbort as abort:
            return self._abort(transfer.target, abort.code)
        if transfer.is_over:
            self._transfer = None
        return answer

    def _begin(self, specifier: int, command: int, request: bytes, now: int) -> bytes:
        """Answer the first request of a transfer.

        Raises:
            SdoAbort: 0504 0001, or that of the transfer.
        """
        if specifier == _INITIATE_UPLOAD:
            return self._initiate_upload(request, now)
        if specifier == _INITIATE_DOWNLOAD:
            return self._initiate_download(request, now)
        if specifier == _BLOCK_UPLOAD and not command & 3:
            return self._initiate_block_upload(request, now)
        if specifier == _BLOCK_DOWNLOAD and not command & 1:
            return self._initiate_block_download(request, now)
        raise SdoAbort(*abort_codes.COMMAND_SPECIFIER)

    def _abort(self, target: Multiplexer, code: int) -> bytes:
        self._transfer = None
        self._counters.sdo_aborts += 1
        return _LONG.pack(_ABORT << 5, *target, code)

    def _initiate_upload(self, request: bytes, now: int) -> bytes:
        target = _parse_object(request)
        return self._answer_upload(target, self._object_dictionary.upload(*target), now)

    def _answer_upload(self, target: Multiplexer, data: bytes, now: int) -> bytes:
        """Answer with the data themselves up to 4 bytes, else with their length."""
        length = len(data)
        if 1 <= length <= 4:
            command = 0x40 | (4 - length) << 2 | _EXPEDITED | _SIZE_INDICATED
            return _SHORT.pack(command, *target, data)
        self._transfer = SegmentedUpload(target, data, now)
        return _LONG.pack(0x40 | _SIZE_INDICATED, *target, length)

    def _initiate_block_upload(self, request: bytes, now: int) -> bytes:
        """Answer with the length; up to the client's threshold, with a plain upload instead."""
        target = _parse_object(request)
        data = self._object_dictionary.upload(*target)
        transfer = BlockUpload(target, data, request[4], now)
        threshold = request[5]
        if threshold and len(data) <= threshold:
            return self._answer_upload(target, data, now)
        self._transfer = transfer
        return _LONG.pack(0xC0 | _BLOCK_CRC | _BLOCK_SIZE_INDICATED, *target, len(data))

    def _initiate_download(self, request: bytes, now: int) -> bytes:
        target = _parse_object(request)
        command = request[0]
        variable = self._object_dictionary.writable(*target)
        data_type = variable.data_type
        is_sized = command & _SIZE_INDICATED
        if command & _EXPEDITED:
            # Without a size, the object's own counts: 4 bytes at most are there.
            length = 4 - (command >> 2 & 3) if is_sized else min(data_type.size or 4, 4)
            variable.write(data_type.decode(request[4 : 4 + length]))
        else:
            announced, limit = self._expect(request, is_sized=bool(is_sized))
            write = partial(self._object_dictionary.download, *target)
            self._transfer = SegmentedDownload(target, write, announced, limit, now)
        return _LONG.pack(0x60, *target, 0)

    def _initiate_block_download(self, request: bytes, now: int) -> bytes:
        target = _parse_object(request)
        command = request[0]
        announced, limit = self._expect(request, is_sized=bool(command & _BLOCK_SIZE_INDICATED))
        write = partial(self._object_dictionary.download, *target)
        self._transfer = BlockDownload(
            target, write, announced, limit, now, has_crc=bool(command & _BLOCK_CRC)
        )
        return _LONG.pack(0xA0 | _BLOCK_CRC, *target, BLOCK_SIZE)

    def _expect(self, request: bytes, *, is_sized: bool) -> tuple[int | None, int]:
        """Return the announced length, None for none, and the longest possible one [byte]."""
        variable = self._object_dictionary.writable(*_parse_object(request))
        limit = variable.most_bytes(BUFFER_SIZE)
        if not is_sized:
            return None, limit
        announced: int = _LONG.unpack(request)[3]
        variable.data_type.check_size(announced)
        check_bound(announced, limit)
        return announced, limit


def _parse_object(request: bytes) -> Multiplexer:
    return request[1] | request[2] << 8, request[3]


def _names_no_object(command: int) -> bool:
    """Return True if a request with this command byte is part of a transfer and names no object."""
    specifier = command >> 5
    return (
        specifier in _SEGMENTS
        or (specifier == _BLOCK_UPLOAD and command & 3 != 0)
        or (specifier == _BLOCK_DOWNLOAD and command & 1 != 0)
    )


# SDO server parameters 0x1200 to 0x127F (CiA 301): the channels of a node, each by itself.


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
