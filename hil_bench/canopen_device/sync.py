"""SYNC and TIME: the messages by which devices know a time."""

import struct
from collections.abc import Iterator
from typing import Final, NamedTuple

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.agenda import MILLISECOND, NEVER, Agenda
from hil_bench.canopen_device.emcy import COMMUNICATION, SYNC_LENGTH, EmcyProducer
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.frame import (
    BIT_30,
    DISABLED,
    Frame,
    Handler,
    can_id,
    check_identifier,
)
from hil_bench.canopen_device.nmt import COMMUNICATING, NmtState
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.service import NodeCounters, Service

# SYNC (CiA 301, synchronisation object): consumer, producer and the synchronous window.
#
# 0x1005 is the identifier and, in bit 30, whether this device is the producer; 0x1006 the period of
# the producer, 0x1007 the window, 0x1019 where the counter overflows (0 for none).


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


# TIME consumer (CiA 301, time stamp object): 0x1012.


_TIME_COB_ID: Final = 0x1012
_CONSUMES: Final = DISABLED
"""Bit 31 of 0x1012 says that the device consumes TIME; that of other COB-IDs disables them."""

_MESSAGE: Final = struct.Struct("<IH")
_MILLISECONDS: Final = (1 << 28) - 1
_DAY: Final = 24 * 3600 * 1000 * MILLISECOND


class TimeOfDay(NamedTuple):
    """TIME_OF_DAY of CiA 301.

    Attributes:
        days: since 1 January 1984.
        milliseconds: since midnight.
    """

    days: int
    milliseconds: int


class TimeConsumer(Service):
    """Keeps the time of day that the last TIME message told."""

    def __init__(self, object_dictionary: ObjectDictionary, counters: NodeCounters) -> None:
        self._is_enabled = False
        self._object_dictionary = object_dictionary
        self._counters = counters
        self._midnight: int | None = None
        self._days = 0
        if _TIME_COB_ID in object_dictionary:
            object_dictionary.add_check(_TIME_COB_ID, 0, self._check_cob_id)

    def handlers(self) -> Iterator[tuple[int | None, Handler]]:
        """Yield that of TIME; its identifier is None while the device does not consume it."""
        cob_id = self._object_dictionary.number(_TIME_COB_ID)
        yield can_id(cob_id & ~_CONSUMES) if cob_id & _CONSUMES else None, self._receive

    def enter(self, state: NmtState) -> None:
        """Begin or end to take TIME."""
        self._is_enabled = state in COMMUNICATING

    def _receive(self, frame: Frame, now: int) -> None:
        if not self._counters.is_data(frame) or not self._is_enabled:
            return
        if len(frame.data) != _MESSAGE.size:
            self._counters.malformed_time += 1
            return
        milliseconds, self._days = _MESSAGE.unpack(frame.data)
        self._midnight = now - (milliseconds & _MILLISECONDS) * MILLISECOND

    def time_of_day(self, now: int) -> TimeOfDay | None:
        """Return the time of day at `now` [ns], None before the first TIME message."""
        if self._midnight is None:
            return None
        days, rest = divmod(now - self._midnight, _DAY)
        return TimeOfDay(self._days + days, rest // MILLISECOND)

    def reset(self, node_id: int) -> None:  # noqa: ARG002 - the identifier comes from 0x1012
        """Forget the time of day."""
        self._midnight = None

    def _check_cob_id(self, cob_id: int) -> None:
        """Refuse bit 30, which would make this device the producer, and as any COB-ID does.

        Raises:
            SdoAbort: 0609 0030.
        """
        check_identifier(cob_id & ~_CONSUMES)
        present = self._object_dictionary.number(_TIME_COB_ID)
        stays = present & cob_id & _CONSUMES
        if cob_id & BIT_30 or (stays and (present ^ cob_id) & _CAN_ID):
            raise SdoAbort(*abort_codes.VALUE)
