"""SYNC consumer (CiA 301, synchronisation object): 0x1005 and the length that 0x1019 asks for."""

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.cob_id import BIT_30, DISABLED, can_id, check_identifier
from hil_bench.canopen_device.counters import NodeCounters
from hil_bench.canopen_device.emcy import COMMUNICATION, SYNC_LENGTH, EmcyProducer
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.errors import SdoAbort


class SyncConsumer:
    """Knows which frame is SYNC, and whether it has the length that it should.

    A SYNC of an unexpected length is acted on all the same. Where 0x1019 asks for a counter, one
    without it also raises EMCY 0x8240; a counter that was not asked for is only counted.
    """

    def __init__(
        self, object_dictionary: ObjectDictionary, emcy: EmcyProducer, counters: NodeCounters
    ) -> None:
        self._object_dictionary = object_dictionary
        self._emcy = emcy
        self._counters = counters
        if object_dictionary.find(0x1005) is not None:
            object_dictionary.add_check(0x1005, 0, _check_cob_id)
        if object_dictionary.find(0x1019) is not None:
            object_dictionary.add_check(0x1019, 0, _check_overflow)

    @property
    def can_id(self) -> int | None:
        """The identifier of SYNC, None where the device has no 0x1005."""
        value = self._object_dictionary.number(0x1005, absent=DISABLED)
        # Bit 31 of 0x1005 means nothing (CiA 301), unlike that of the other COB-IDs.
        return can_id(value & ~DISABLED) if 0x1005 in self._object_dictionary else None

    def check_length(self, length: int) -> None:
        """Count a SYNC of unexpected `length` [byte], and report it where a counter is due."""
        has_counter = self._object_dictionary.number(0x1019) > 0
        if length == int(has_counter):
            self._emcy.clear_error(SYNC_LENGTH)
            return
        self._counters.unexpected_sync_length += 1
        if has_counter:
            self._emcy.raise_error(SYNC_LENGTH, COMMUNICATION)


def _check_cob_id(cob_id: int) -> None:
    """Refuse bit 30, which would make this device the SYNC producer, and odd identifiers.

    Raises:
        SdoAbort: 0609 0030.
    """
    if cob_id & BIT_30:
        raise SdoAbort(*abort_codes.VALUE)
    check_identifier(cob_id & ~DISABLED)


def _check_overflow(value: int) -> None:
    """Refuse all but 0 (no counter) and 2 to 240 (CiA 301, 0x1019).

    Raises:
        SdoAbort: 0609 0030.
    """
    if value == 1 or value > 240:
        raise SdoAbort(*abort_codes.VALUE)
