"""SYNC (CiA 301, synchronisation object): consumer, producer and the synchronous window.

0x1005 is the identifier and, in bit 30, whether this device is the producer; 0x1006 the period of
the producer, 0x1007 the window, 0x1019 where the counter overflows (0 for none).
"""

from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.agenda import NEVER, Agenda
from hil_bench.canopen_device.cob_id import BIT_30, DISABLED, can_id, check_identifier
from hil_bench.canopen_device.emcy import COMMUNICATION, SYNC_LENGTH, EmcyProducer
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.service import NodeCounters

SYNC_COB_ID: Final = 0x080
"""Identifier of SYNC in the predefined connection set."""

_COB_ID: Final = 0x1005
_PERIOD: Final = 0x1006
_WINDOW: Final = 0x1007
_OVERFLOW: Final = 0x1019

_MICROSECOND: Final = 1000
_CAN_ID: Final = 0x7FF
_FIRST_COUNT: Final = 1


class SynchronousWindow:
    """The time after a SYNC in which synchronous PDOs count; those after it are discarded.

    Attributes:
        end: its end [ns]; NEVER where 0x1007 is 0 or absent.
    """

    __slots__ = ("end",)

    def __init__(self) -> None:
        self.end = NEVER


class SyncConsumer:
    """Knows which frame is SYNC, and whether it has the length that it should.

    A SYNC of an unexpected length is acted on all the same. Where 0x1019 asks for a counter, one
    without it also raises EMCY 0x8240; a counter that was not asked for is only counted.

    Attributes:
        received: SYNCs so far.
    """

    def __init__(
        self,
        object_dictionary: ObjectDictionary,
        window: SynchronousWindow,
        emcy: EmcyProducer,
        counters: NodeCounters,
    ) -> None:
        self.received = 0
        self._object_dictionary = object_dictionary
        self._window_length = object_dictionary.find(_WINDOW)
        self._overflow = object_dictionary.find(_OVERFLOW)
        self._window = window
        self._emcy = emcy
        self._counters = counters
        self._has_failed = False

    @property
    def can_id(self) -> int | None:
        """The identifier of SYNC; of a device without 0x1005, that of CiA 301."""
        value = self._object_dictionary.number(_COB_ID, absent=SYNC_COB_ID)
        # Bit 31 of 0x1005 means nothing (CiA 301), unlike that of the other COB-IDs.
        return can_id(value & ~DISABLED)

    def receive(self, data: bytes, now: int) -> int:
        """Take a SYNC and return its counter, 0 where it has none or none is asked for."""
        self.received += 1
        length: int = 0 if self._window_length is None else self._window_length.value
        self._window.end = now + length * _MICROSECOND if length else NEVER
        overflow: int = 0 if self._overflow is None else self._overflow.value
        has_counter = overflow > 0
        if len(data) != has_counter or self._has_failed:
            self._judge(len(data), has_counter=has_counter)
        return data[0] if has_counter and data else 0

    def reset(self) -> None:
        """Begin anew: the window is open until the first SYNC."""
        self._window.end = NEVER
        self._has_failed = False

    def _judge(self, length: int, *, has_counter: bool) -> None:
        """Raise or clear the error that the length of a SYNC means."""
        is_unexpected = length != has_counter
        self._counters.unexpected_sync_length += is_unexpected
        self._has_failed = is_unexpected and has_counter
        if self._has_failed:
            self._emcy.raise_error(SYNC_LENGTH, COMMUNICATION)
        else:
            self._emcy.clear_error(SYNC_LENGTH)


class SyncProducer:
    """Sends SYNC every 0x1006 microseconds while bit 30 of 0x1005 is set.

    The first SYNC goes at once. Of a period that is shorter than a round, `periods` refuses the
    writing; one by default gives one SYNC a round.

    Attributes:
        is_producing: whether this device is the producer, and sends.
        due: when the next SYNC is to be sent [ns].
    """

    def __init__(self, object_dictionary: ObjectDictionary, agenda: Agenda) -> None:
        self.is_producing = False
        self.due = NEVER
        self._object_dictionary = object_dictionary
        self._agenda = agenda
        self._is_enabled = False
        self._count = _FIRST_COUNT
        self._watch_parameters()

    def set_enabled(self, *, is_enabled: bool) -> None:
        """Begin to send, the counter at 1, or end it."""
        if is_enabled is self._is_enabled:
            return
        self._is_enabled = is_enabled
        self._count = _FIRST_COUNT
        self._start()

    def expire(self, now: int) -> Frame | None:
        """Return the SYNC to be sent now, None while it is not yet due."""
        if now < self.due:
            return None
        period = self._object_dictionary.number(_PERIOD) * _MICROSECOND
        # On the grid of the period, unless it has just begun (due 0) or was missed altogether.
        following = (self.due or now) + period
        self.due = following if following > now else now + period
        cob_id = self._object_dictionary.number(_COB_ID)
        return Frame(cob_id & _CAN_ID, self._next_data())

    def _next_data(self) -> bytes:
        overflow = self._object_dictionary.number(_OVERFLOW)
        if not overflow:
            return b""
        count = self._count
        self._count = count + 1 if count < overflow else _FIRST_COUNT
        return bytes([count])

    def _start(self, _value: int = 0) -> None:
        is_producer = bool(self._object_dictionary.number(_COB_ID) & BIT_30)
        is_enabled = self._is_enabled and is_producer
        self.is_producing = is_enabled and self._object_dictionary.number(_PERIOD) > 0
        self.due = 0 if self.is_producing else NEVER
        self._agenda.bring_forward(self.due)

    def _watch_parameters(self) -> None:
        checks = {_COB_ID: self._check_cob_id, _OVERFLOW: self._check_overflow}
        for index in (_COB_ID, _PERIOD, _OVERFLOW):
            variable = self._object_dictionary.find(index)
            if variable is None:
                continue
            if index in checks:
                variable.add_check(checks[index])
            variable.add_hook(self._restart_counter if index == _OVERFLOW else self._start)

    def _restart_counter(self, _overflow: int) -> None:
        self._count = _FIRST_COUNT

    def _check_cob_id(self, cob_id: int) -> None:
        """Refuse odd identifiers, another one while producing, and a producer without 0x1006.

        Raises:
            SdoAbort: 0609 0030.
        """
        check_identifier(cob_id & ~DISABLED)
        if cob_id & BIT_30 and _PERIOD not in self._object_dictionary:
            raise SdoAbort(*abort_codes.VALUE)
        present = self._object_dictionary.number(_COB_ID)
        if present & cob_id & BIT_30 and (present ^ cob_id) & _CAN_ID:
            raise SdoAbort(*abort_codes.VALUE)

    def _check_overflow(self, value: int) -> None:
        """Refuse all but 0 (no counter) and 2 to 240, and any change while there is a period.

        Raises:
            SdoAbort: 0609 0030 the value, 0800 0022 while 0x1006 is not 0.
        """
        if value == 1 or value > 240:
            raise SdoAbort(*abort_codes.VALUE)
        if self._object_dictionary.number(_PERIOD):
            raise SdoAbort(*abort_codes.DEVICE_STATE)
