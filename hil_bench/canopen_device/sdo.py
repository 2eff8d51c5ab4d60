"""SDO server (CiA 301, service data objects): expedited and segmented transfers.

Requests wait in a bounded queue and are answered in order by `serve`. Each gets exactly one answer,
but for an abort from the client, a frame of fewer than 8 bytes, and a request outside the NMT
states that have SDO: these get none.

Command bytes, request to response (CiA 301): ccs 1 initiate download, ccs 0 download segment, ccs 2
initiate upload, ccs 3 upload segment, cs 4 abort. All others abort with 0504 0001.
"""

import struct
from collections import deque
from dataclasses import dataclass, field
from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.agenda import MILLISECOND, NEVER, Agenda
from hil_bench.canopen_device.counters import NodeCounters
from hil_bench.canopen_device.frame import Emit, Frame
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.errors import SdoAbort

REQUEST: Final = 0x600
"""Identifier of the default SDO channel, client to server, plus the node-ID."""
RESPONSE: Final = 0x580
"""Identifier of the default SDO channel, server to client, plus the node-ID."""

TIME_OUT: Final = 1000 * MILLISECOND
"""Longest wait for the client's next segment [ns]."""
BUFFER_SIZE: Final = 65536
"""Longest string or domain that a client may download [byte]."""
QUEUE_LENGTH: Final = 256
"""Requests that may wait; more than a bus brings in 30 ms."""

_DOWNLOAD_SEGMENT: Final = 0
_INITIATE_DOWNLOAD: Final = 1
_INITIATE_UPLOAD: Final = 2
_UPLOAD_SEGMENT: Final = 3
_ABORT: Final = 4

_EXPEDITED: Final = 0x02
_SIZE_INDICATED: Final = 0x01
_TOGGLE: Final = 0x10
_LAST: Final = 0x01
_SEGMENT_BYTES: Final = 7

_HEADER: Final = struct.Struct("<BHB")
_LONG: Final = struct.Struct("<BHBI")


_Object = tuple[int, int]
"""The multiplexer, index and sub-index: which object a transfer is about."""


@dataclass(slots=True)
class _Upload:
    """A segmented upload: what is still to be sent."""

    target: _Object
    rest: bytes
    due: int
    toggle: int = 0


@dataclass(slots=True)
class _Download:
    """A segmented download: what came so far, and how much is announced."""

    target: _Object
    announced: int | None
    limit: int
    due: int
    data: bytearray = field(default_factory=bytearray)
    toggle: int = 0


_NO_OBJECT: Final[_Object] = (0, 0)


class SdoServer:
    """The default SDO channel of one node."""

    def __init__(
        self,
        object_dictionary: ObjectDictionary,
        node_id: int,
        agenda: Agenda,
        counters: NodeCounters,
    ) -> None:
        self._object_dictionary = object_dictionary
        self._can_id = RESPONSE + node_id
        self._agenda = agenda
        self._counters = counters
        self._queue: deque[bytes] = deque()
        self._transfer: _Upload | _Download | None = None

    @property
    def due(self) -> int:
        """When the transfer under way times out [ns]."""
        return NEVER if self._transfer is None else self._transfer.due

    def receive(self, data: bytes) -> None:
        """Queue a request."""
        if len(data) < 8:
            self._counters.short_sdo_requests += 1
        elif len(self._queue) >= QUEUE_LENGTH:
            self._counters.dropped_sdo_requests += 1
        else:
            self._queue.append(data)
            self._agenda.bring_forward(0)

    def reset(self) -> None:
        """Forget all requests and the transfer under way, without an answer."""
        self._queue.clear()
        self._transfer = None

    def serve(self, now: int, emit: Emit) -> None:
        """Answer what was asked, then abort a transfer whose client has gone silent."""
        while self._queue:
            answer = self._answer(self._queue.popleft(), now)
            if answer is not None:
                emit(Frame(self._can_id, answer))
        if self._transfer is not None and now >= self._transfer.due:
            target = self._transfer.target
            emit(Frame(self._can_id, self._abort(target, abort_codes.TIME_OUT[0])))

    def _answer(self, request: bytes, now: int) -> bytes | None:
        specifier = request[0] >> 5
        if specifier == _ABORT:
            self._transfer = None
            return None
        try:
            return self._dispatch(specifier, request, now)
        except SdoAbort as abort:
            return self._abort(self._target(request, specifier), abort.code)

    def _dispatch(self, specifier: int, request: bytes, now: int) -> bytes:
        if specifier == _INITIATE_UPLOAD:
            return self._initiate_upload(request, now)
        if specifier == _INITIATE_DOWNLOAD:
            return self._initiate_download(request, now)
        if specifier == _UPLOAD_SEGMENT:
            return self._upload_segment(request, now)
        if specifier == _DOWNLOAD_SEGMENT:
            return self._download_segment(request, now)
        raise SdoAbort(*abort_codes.COMMAND_SPECIFIER)

    def _target(self, request: bytes, specifier: int) -> _Object:
        """The object that an abort names: a segment belongs to that of the transfer."""
        if specifier not in {_UPLOAD_SEGMENT, _DOWNLOAD_SEGMENT}:
            return _parse_object(request)
        return _NO_OBJECT if self._transfer is None else self._transfer.target

    def _abort(self, target: _Object, code: int) -> bytes:
        self._transfer = None
        self._counters.sdo_aborts += 1
        return _LONG.pack(_ABORT << 5, *target, code)

    def _initiate_upload(self, request: bytes, now: int) -> bytes:
        """Answer with the data themselves up to 4 bytes, else with their length."""
        self._transfer = None
        target = _parse_object(request)
        data = self._object_dictionary.upload(*target)
        length = len(data)
        if 1 <= length <= 4:
            command = 0x40 | (4 - length) << 2 | _EXPEDITED | _SIZE_INDICATED
            return _HEADER.pack(command, *target) + data.ljust(4, b"\0")
        self._transfer = _Upload(target, data, now + TIME_OUT)
        return _LONG.pack(0x40 | _SIZE_INDICATED, *target, length)

    def _upload_segment(self, request: bytes, now: int) -> bytes:
        upload = self._transfer
        if not isinstance(upload, _Upload):
            raise SdoAbort(*abort_codes.COMMAND_SPECIFIER)
        _check_toggle(upload, request[0])
        segment, upload.rest = upload.rest[:_SEGMENT_BYTES], upload.rest[_SEGMENT_BYTES:]
        answer = upload.toggle | (_SEGMENT_BYTES - len(segment)) << 1
        upload.toggle ^= _TOGGLE
        upload.due = now + TIME_OUT
        if not upload.rest:
            answer |= _LAST
            self._transfer = None
        return bytes([answer]) + segment.ljust(_SEGMENT_BYTES, b"\0")

    def _initiate_download(self, request: bytes, now: int) -> bytes:
        self._transfer = None
        target = _parse_object(request)
        command = request[0]
        data_type = self._object_dictionary.writable(*target).data_type
        is_sized = command & _SIZE_INDICATED
        if command & _EXPEDITED:
            # Without a size, the object's own counts: 4 bytes at most are there.
            length = 4 - (command >> 2 & 3) if is_sized else min(data_type.size or 4, 4)
            self._object_dictionary.download(*target, request[4 : 4 + length])
        else:
            announced = _LONG.unpack(request)[3] if is_sized else None
            limit = data_type.size or BUFFER_SIZE
            if announced is not None:
                data_type.check_size(announced)
                _check_bound(announced, limit)
            self._transfer = _Download(target, announced, limit, now + TIME_OUT)
        return _LONG.pack(0x60, *target, 0)

    def _download_segment(self, request: bytes, now: int) -> bytes:
        download = self._transfer
        if not isinstance(download, _Download):
            raise SdoAbort(*abort_codes.COMMAND_SPECIFIER)
        command = request[0]
        _check_toggle(download, command)
        length = _SEGMENT_BYTES - (command >> 1 & 7)
        download.data += request[1 : 1 + length]
        limit = download.limit if download.announced is None else download.announced
        _check_bound(len(download.data), limit)
        answer = 0x20 | download.toggle
        download.toggle ^= _TOGGLE
        download.due = now + TIME_OUT
        if command & _LAST:
            self._finish(download)
        return bytes([answer]) + bytes(_SEGMENT_BYTES)

    def _finish(self, download: _Download) -> None:
        if download.announced is not None and len(download.data) < download.announced:
            raise SdoAbort(*abort_codes.LENGTH_TOO_LOW)
        self._object_dictionary.download(*download.target, bytes(download.data))
        self._transfer = None


def _parse_object(request: bytes) -> _Object:
    return request[1] | request[2] << 8, request[3]


def _check_toggle(transfer: _Upload | _Download, command: int) -> None:
    if command & _TOGGLE != transfer.toggle:
        raise SdoAbort(*abort_codes.TOGGLE)


def _check_bound(length: int, limit: int) -> None:
    if length > limit:
        raise SdoAbort(*abort_codes.LENGTH_TOO_HIGH)
