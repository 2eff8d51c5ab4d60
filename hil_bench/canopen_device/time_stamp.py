"""TIME consumer (CiA 301, time stamp object): 0x1012."""

import struct
from collections.abc import Iterator
from typing import Final, NamedTuple

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.agenda import MILLISECOND
from hil_bench.canopen_device.cob_id import BIT_30, DISABLED, can_id, check_identifier
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.frame import Frame, Handler
from hil_bench.canopen_device.nmt import COMMUNICATING, NmtState
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.service import NodeCounters, Service

_COB_ID: Final = 0x1012
_CONSUMES: Final = DISABLED
"""Bit 31 of 0x1012 says that the device consumes TIME; that of other COB-IDs disables them."""

_MESSAGE: Final = struct.Struct("<IH")
_MILLISECONDS: Final = (1 << 28) - 1
_DAY: Final = 24 * 3600 * 1000 * MILLISECOND
_CAN_ID: Final = 0x7FF


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
        if _COB_ID in object_dictionary:
            object_dictionary.add_check(_COB_ID, 0, self._check_cob_id)

    def handlers(self) -> Iterator[tuple[int | None, Handler]]:
        """Yield that of TIME; its identifier is None while the device does not consume it."""
        cob_id = self._object_dictionary.number(_COB_ID)
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
        present = self._object_dictionary.number(_COB_ID)
        stays = present & cob_id & _CONSUMES
        if cob_id & BIT_30 or (stays and (present ^ cob_id) & _CAN_ID):
            raise SdoAbort(*abort_codes.VALUE)
