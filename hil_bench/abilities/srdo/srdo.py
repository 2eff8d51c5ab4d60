"""Safety-relevant data objects (EN 50325-5, formerly CiA 304): two frames, the second inverted.

SRDO n, 1 to 64, has its parameters in 0x1301 and following: .01 direction (0 off, 1 sent, 2
received), .02 refresh time of the sender or safeguard cycle time SCT of the receiver [ms], .03
safety-relevant validation time SRVT [ms], .04 transmission type (254), .05 and .06 the identifiers
of the plain and of the inverted frame. In 0x1381 and following stands the mapping, in pairs: odd
sub-indices what the plain frame carries, even ones what the inverted one does.

A sender sends both frames each refresh time, one after the other. A receiver takes the plain frame
only with an inverted one that comes within the SRVT and agrees bit by bit; where no such pair has
come by the end of the SCT, or one disagrees, the communication has failed: EMCY, an event, and
nothing is taken until the node enters OPERATIONAL anew. A frame at the very end of a time is in
time; later frames are not, though they share a tick with the look at the time.

SRDOs live in OPERATIONAL, and only while the configuration is valid: 0x13FE holds 0xA5 and 0x13FF.n
the CRC of the parameters (`signature`). Each write to a parameter sets 0x13FE to 0; in OPERATIONAL
nothing of all this is written (0800 0022). A device delivered with 0x13FE = 0xA5 and 0x13FF.n = 0
fills in its signatures at power-on, and identifiers of 0 are those of the pre-defined set, 0xFF +
2 x node-ID and 0x100 + 2 x node-ID.

Sources: object layout, valid mark and signature as CANopenNode has them; the text of the standard
was not at hand. EMCY codes, the filling in and the inverted frame as inversion of the same mapped
objects are this device's own.
"""

import struct
from binascii import crc_hqx
from collections.abc import Iterator
from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.agenda import MILLISECOND, NEVER, Agenda
from hil_bench.canopen_device.emcy import COMMUNICATION, EmcyProducer
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.events import NodeEvent, NodeEventKind, NodeEvents
from hil_bench.canopen_device.frame import Emit, Frame, Handler, make_frame
from hil_bench.canopen_device.nmt import NmtState
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.pdo_parameters import Direction, MappingEntry, PdoMapping
from hil_bench.canopen_device.service import AddedService

PARAMETERS: Final = range(0x1301, 0x1341)
CONFIGURATION_VALID: Final = 0x13FE
SIGNATURES: Final = 0x13FF
VALID: Final = 0xA5

FAILED_EMCY: Final = 0x8F00
"""The communication of an SRDO has failed."""
CONFIGURATION_EMCY: Final = 0x6300
"""An SRDO is on, and its configuration is not valid."""

_TO_MAPPING: Final = 0x80
_GUARDED: Final = range(PARAMETERS.start, SIGNATURES + 1)
_DIRECTION, _CYCLE, _VALIDATION, _PLAIN, _INVERTED = 1, 2, 3, 5, 6
_OFF, _SENT, _RECEIVED = 0, 1, 2
_IDENTIFIERS: Final = range(0x101, 0x181)
_FIRST_PLAIN: Final = 0xFF
_MOST_NODES: Final = 64


def signature(object_dictionary: ObjectDictionary, number: int) -> int:
    """Return the CRC-16 (CCITT, from 0) of the parameters and the mapping of SRDO `number`."""
    index = PARAMETERS.start + number - 1
    mapping = index + _TO_MAPPING
    od = object_dictionary.number
    parts = [
        struct.pack(
            "<BHBIIB",
            od(index, _DIRECTION),
            od(index, _CYCLE),
            od(index, _VALIDATION),
            od(index, _PLAIN),
            od(index, _INVERTED),
            od(mapping),
        )
    ]
    parts += [struct.pack("<BI", sub, od(mapping, sub)) for sub in range(1, od(mapping) + 1)]
    return crc_hqx(b"".join(parts), 0)


def invert(data: bytes) -> bytes:
    """Return bytes with every bit turned round."""
    return bytes(byte ^ 0xFF for byte in data)


class Srdo:
    """One SRDO.

    Attributes:
        number: 1 to 64.
        due: when a sender sends, or a receiver has failed [ns]; NEVER while it is off.
        can_ids: its two identifiers.
    """

    def __init__(self, od: ObjectDictionary, number: int) -> None:
        self.number = number
        self.due = NEVER
        self.can_ids = (0, 0)
        self._od = od
        self._index = PARAMETERS.start + number - 1
        self._mapping: PdoMapping | None = None
        self._is_sender = False
        self._cycle = self._validation = 0
        self._plain: bytes | None = None
        self._half_until = NEVER

    @property
    def deadline(self) -> int:
        """When it has something to do, or to fail [ns]."""
        return min(self.due, self._half_until)

    @property
    def direction(self) -> int:
        """0 off, 1 sent, 2 received."""
        return self._od.number(self._index, _DIRECTION)

    def follow_node_id(self, node_id: int) -> None:
        """Take the identifiers of the pre-defined set where none are given."""
        for place, subindex in enumerate((_PLAIN, _INVERTED)):
            variable = self._od.find(self._index, subindex)
            if variable is not None and not variable.value and node_id <= _MOST_NODES:
                variable.value = _FIRST_PLAIN + place + 2 * node_id

    def start(self, now: int) -> None:
        """Begin to send or to wait.

        Raises:
            SdoAbort: its identifiers or its mapping cannot be.
        """
        od, index = self._od, self._index
        self.can_ids = od.number(index, _PLAIN), od.number(index, _INVERTED)
        if any(can_id not in _IDENTIFIERS for can_id in self.can_ids):
            raise SdoAbort(*abort_codes.VALUE)
        self._is_sender = self.direction == _SENT
        self._cycle = od.number(index, _CYCLE) * MILLISECOND
        self._validation = od.number(index, _VALIDATION) * MILLISECOND
        mapping = index + _TO_MAPPING
        words = [od.number(mapping, sub) for sub in range(1, od.number(mapping) + 1)]
        if not words or len(words) % 2 or words[::2] != words[1::2] or not self._cycle:
            raise SdoAbort(*abort_codes.VALUE)
        entries = [MappingEntry.parse(word) for word in words[::2]]
        direction = Direction.TPDO if self._is_sender else Direction.RPDO
        self._mapping = PdoMapping(od, entries, direction)
        self._plain, self._half_until = None, NEVER
        self.due = now if self._is_sender else now + self._cycle

    def stop(self) -> None:
        """End to send or to wait."""
        self.due = self._half_until = NEVER
        self._mapping = None

    def send(self, now: int, emit: Emit) -> None:
        """Send both frames, if this is a sender and it is time."""
        if not self._is_sender or now < self.due or self._mapping is None:
            return
        data = self._mapping.read()
        plain, inverted = self.can_ids
        emit(make_frame(Frame, (plain, data, False, False, 0, 0)))
        emit(make_frame(Frame, (inverted, invert(data), False, False, 0, 0)))
        self.due += self._cycle
        if self.due <= now:
            self.due = now + self._cycle

    def receive(self, frame: Frame, now: int) -> bool:
        """Take a frame with one of its identifiers; return whether the communication has failed."""
        mapping = self._mapping
        if mapping is None or self._is_sender:
            return False
        if len(frame.data) != mapping.length or now > self.due:
            return True
        if frame.can_id == self.can_ids[0]:
            self._plain, self._half_until = frame.data, now + self._validation
            return False
        plain, until = self._plain, self._half_until
        self._plain, self._half_until = None, NEVER
        if plain is None:
            return False  # what it belongs to may be lost; the SCT sees to that
        if now > until or invert(frame.data) != plain:
            return True
        mapping.write(plain)
        self.due = now + self._cycle
        return False

    def has_timed_out(self, now: int) -> bool:
        """Return True if the SCT of a receiver has expired, or the SRVT for an inverted frame.

        The frames that came until `now` have been taken by then.
        """
        return not self._is_sender and now >= self.deadline


class Srdos(AddedService):
    """All SRDOs of a node."""

    def __init__(
        self,
        od: ObjectDictionary,
        node_id: int,
        agenda: Agenda,
        events: NodeEvents,
        emcy: EmcyProducer,
    ) -> None:
        self._od = od
        self._agenda = agenda
        self._events = events
        self._emcy = emcy
        self._srdos = tuple(
            Srdo(od, index - PARAMETERS.start + 1) for index in od.indices(PARAMETERS)
        )
        self._state = NmtState.INITIALISING
        self._must_start = False
        for index in od.indices(_GUARDED):
            for variable in od.entries(index):
                variable.add_check(self._check_state)
                if index < CONFIGURATION_VALID:
                    variable.add_hook(self._invalidate)
        self.reset(node_id)

    def handlers(self) -> Iterator[tuple[int | None, Handler]]:
        """Yield the identifiers of received SRDOs."""
        for srdo in self._srdos:
            if srdo.direction == _RECEIVED:
                index = PARAMETERS.start + srdo.number - 1
                for subindex in (_PLAIN, _INVERTED):
                    can_id = self._od.number(index, subindex)
                    if can_id in _IDENTIFIERS:
                        yield can_id, self._receive

    def enter(self, state: NmtState) -> None:
        """Begin in OPERATIONAL, end on leaving it."""
        self._state = state
        self._must_start = state is NmtState.OPERATIONAL
        for srdo in self._srdos:
            srdo.stop()
            for code in (FAILED_EMCY, CONFIGURATION_EMCY):
                self._emcy.clear_error(code, srdo.number)

    def reset(self, node_id: int) -> None:
        """Fill in what a device is delivered with: identifiers and signatures."""
        for srdo in self._srdos:
            srdo.follow_node_id(node_id)
        if self._od.number(CONFIGURATION_VALID) == VALID:
            for srdo in self._srdos:
                stored = self._od.find(SIGNATURES, srdo.number)
                if stored is not None and not stored.value:
                    stored.value = signature(self._od, srdo.number)

    def serve(self, now: int, emit: Emit) -> int:
        """Send what is due; return when there is more to do [ns]."""
        if self._must_start:
            self._must_start = False
            self._start(now)
        for srdo in self._srdos:
            srdo.send(now, emit)
        return self._deadline()

    def expire(self, now: int) -> None:
        """Let receivers fail that waited too long."""
        for srdo in self._srdos:
            if srdo.has_timed_out(now):
                self._fail(srdo)

    def _start(self, now: int) -> None:
        for srdo in self._srdos:
            if srdo.direction != _OFF and not (self._is_signed(srdo) and _starts(srdo, now)):
                self._emcy.raise_error(CONFIGURATION_EMCY, COMMUNICATION, source=srdo.number)

    def _is_signed(self, srdo: Srdo) -> bool:
        od = self._od
        stored = od.number(SIGNATURES, srdo.number)
        return od.number(CONFIGURATION_VALID) == VALID and stored == signature(od, srdo.number)

    def _receive(self, frame: Frame, now: int) -> None:
        if frame.is_remote or frame.is_extended:
            return
        for srdo in self._srdos:
            if frame.can_id in srdo.can_ids and srdo.receive(frame, now):
                self._fail(srdo)
        self._agenda.bring_forward(self._deadline())

    def _deadline(self) -> int:
        return min((srdo.deadline for srdo in self._srdos), default=NEVER)

    def _fail(self, srdo: Srdo) -> None:
        srdo.stop()
        self._emcy.raise_error(FAILED_EMCY, COMMUNICATION, source=srdo.number)
        self._events.tell(NodeEvent(NodeEventKind.SRDO_FAILED, srdo.number))

    def _check_state(self, _value: int) -> None:
        """Refuse every write in OPERATIONAL.

        Raises:
            SdoAbort: 0800 0022.
        """
        if self._state is NmtState.OPERATIONAL:
            raise SdoAbort(*abort_codes.DEVICE_STATE)

    def _invalidate(self, _value: int) -> None:
        mark = self._od.find(CONFIGURATION_VALID)
        if mark is not None:
            mark.value = 0


def _starts(srdo: Srdo, now: int) -> bool:
    try:
        srdo.start(now)
    except SdoAbort:
        return False
    return True
