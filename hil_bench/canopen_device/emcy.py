"""EMCY producer (CiA 301, emergency object): 0x1001, 0x1003, 0x1014, 0x1015.

An error is reported once when it appears. When the last one is gone, an error reset (code 0x0000)
follows. The error register holds the bits of all present errors; its generic bit is set while
there is any. Messages wait, in a bounded queue, for the inhibit time and for an NMT state in which
EMCY is allowed.
"""

import struct
from collections import deque
from enum import Enum, auto
from typing import Final

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.agenda import INHIBIT_UNIT, NEVER, Agenda
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.frame import DISABLED, Emit, Frame, can_id, check_change
from hil_bench.canopen_device.nmt import COMMUNICATING, NmtState
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.service import NodeCounters, Service

GENERIC: Final = 0x01
"""Error register bit 0: set while there is any error."""
COMMUNICATION: Final = 0x10
"""Error register bit 4: communication error (overrun, error state)."""

DEVICE_PROFILE: Final = 0x20
"""Error register bit 5: what the device profile defines."""

ERROR_RESET: Final = 0x0000
SYNC_LENGTH: Final = 0x8240
HEARTBEAT: Final = 0x8130
PDO_TOO_SHORT: Final = 0x8210
PDO_TOO_LONG: Final = 0x8220
RPDO_TIMEOUT: Final = 0x8250

_QUEUE_LENGTH: Final = 16
_MANUFACTURER_BYTES: Final = 5
_MONITORING: Final = range(0x8100, 0x8300)
_MESSAGE: Final = struct.Struct("<HB5s")


class EmcyProducer(Service):
    """Emergency messages, error register and error history of one node.

    Messages wait while the NMT state does not allow EMCY.
    """

    def __init__(
        self, object_dictionary: ObjectDictionary, agenda: Agenda, counters: NodeCounters
    ) -> None:
        self._is_enabled = False
        self._object_dictionary = object_dictionary
        self._agenda = agenda
        self._counters = counters
        self._present: dict[tuple[int, int], int] = {}
        self._queue: deque[bytes] = deque()
        self._inhibited_until = 0
        self._can_id: int | None = None
        self._watch_parameters()
        self.forget(range(0x10000))

    def raise_error(
        self, code: int, register_bits: int, manufacturer: bytes = b"", source: int = 0
    ) -> None:
        """Report an error that has appeared; without effect while it is present already.

        Args:
            code: emergency error code (CiA 301 and the device profile).
            register_bits: bits of the error register 0x1001; the generic bit is added.
            manufacturer: up to 5 bytes of manufacturer-specific detail.
            source: tells errors of the same code apart, for instance by watched node.

        Raises:
            ValueError: more than 5 bytes of detail.
        """
        if len(manufacturer) > _MANUFACTURER_BYTES:
            raise ValueError(f"{manufacturer!r} is longer than {_MANUFACTURER_BYTES} bytes")
        if (code, source) in self._present:
            return
        self._present[code, source] = register_bits | GENERIC
        self._set_register()
        self._remember(code, manufacturer)
        self._enqueue(code, manufacturer)

    def clear_error(self, code: int, source: int = 0) -> None:
        """Report that an error is gone; without effect where it is not present."""
        if self._present.pop((code, source), None) is None:
            return
        self._set_register()
        if not self._present:
            self._enqueue(ERROR_RESET, b"")

    @property
    def present(self) -> frozenset[int]:
        """The codes of the errors that are present."""
        return frozenset(code for code, _ in self._present)

    @property
    def can_id(self) -> int | None:
        """The identifier of its messages, None where they are switched off."""
        return self._can_id

    def enter(self, state: NmtState) -> None:
        """Begin or end to send."""
        self._is_enabled = state in COMMUNICATING

    def forget(self, restored: range) -> None:
        """Begin anew after the objects `restored` got their defaults.

        A reset of the communication forgets communication and protocol errors (0x81xx, 0x82xx);
        those of the application are still there. A reset of the node forgets all.
        """
        forgets_all = restored.stop > 0x2000
        self._present = {
            key: bits
            for key, bits in self._present.items()
            if not forgets_all and key[0] not in _MONITORING
        }
        self._queue.clear()
        self._inhibited_until = 0
        self._set_register()
        self._clear_history(0)
        self._set_can_id(self._object_dictionary.number(0x1014, absent=DISABLED))

    def serve(self, now: int, emit: Emit) -> int:
        """Send what waits, as far as the inhibit time 0x1015 allows."""
        while self._queue and self._is_enabled and now >= self._inhibited_until:
            data = self._queue.popleft()
            if self._can_id is not None:
                emit(Frame(self._can_id, data))
            inhibit_time = self._object_dictionary.number(0x1015)
            self._inhibited_until = now + inhibit_time * INHIBIT_UNIT
        return self._inhibited_until if self._queue and self._is_enabled else NEVER

    def _watch_parameters(self) -> None:
        cob_id = self._object_dictionary.find(0x1014)
        if cob_id is not None:
            cob_id.add_check(lambda value: check_change(cob_id, value))
            cob_id.add_hook(self._set_can_id)
        count = self._object_dictionary.find(0x1003)
        if count is not None:
            count.add_check(_check_history_count)
            count.add_hook(self._clear_history)

    def _set_can_id(self, cob_id: int) -> None:
        self._can_id = can_id(cob_id)

    def _set_register(self) -> None:
        register = 0
        for bits in self._present.values():
            register |= bits
        variable = self._object_dictionary.find(0x1001)
        if variable is not None:
            variable.value = register

    def _enqueue(self, code: int, manufacturer: bytes) -> None:
        if len(self._queue) >= _QUEUE_LENGTH:
            # The oldest goes: the last one says whether an error is still present.
            self._queue.popleft()
            self._counters.dropped_emcy += 1
        register = self._object_dictionary.number(0x1001)
        self._queue.append(_MESSAGE.pack(code, register, manufacturer))
        self._agenda.bring_forward(self._inhibited_until)

    def _remember(self, code: int, manufacturer: bytes) -> None:
        """Put the error first into 0x1003: the code, and two bytes of detail above it."""
        entry: int | None = code | int.from_bytes(manufacturer[:2], "little") << 16
        count = 0
        while (field := self._object_dictionary.find(0x1003, count + 1)) is not None:
            count += 1
            entry, field.value = field.value, entry
            if entry is None:
                break
        self._set_history_count(count)

    def _clear_history(self, _count: int) -> None:
        """Empty 0x1003; reading an entry then aborts with 0800 0024, as CiA 301 asks."""
        subindex = 1
        while (field := self._object_dictionary.find(0x1003, subindex)) is not None:
            field.value = None
            subindex += 1
        self._set_history_count(0)

    def _set_history_count(self, count: int) -> None:
        variable = self._object_dictionary.find(0x1003)
        if variable is not None:
            variable.value = count


def _check_history_count(count: int) -> None:
    """Refuse all but 0, which empties 0x1003 (CiA 301).

    Raises:
        SdoAbort: 0609 0030.
    """
    if count:
        raise SdoAbort(*abort_codes.VALUE)


# Events of a CAN controller and the reaction of its CANopen device (CiA 301, EMCY).

OVERRUN: Final = 0x8110
"""CAN overrun: objects lost."""

PASSIVE: Final = 0x8120
"""CAN in error passive mode."""

RECOVERED: Final = 0x8140
"""Recovered from bus-off."""


class CanEvent(Enum):
    """An event of a device's CAN controller."""

    PASSIVE = auto()
    """One of its error counters has come to 128."""
    ACTIVE = auto()
    """Both are below 128 again."""
    BUS_OFF = auto()
    """Its transmit error counter has come to 256: it neither sends nor hears."""
    RECOVERED = auto()
    """It takes part again, its counters at 0."""
    OVERRUN = auto()
    """A frame found the transmission buffer full, and is lost."""
    SENT_ALL = auto()
    """After an overrun, the buffer is empty."""


class CanErrors:
    """Turns what the CAN controller tells into emergencies."""

    def __init__(self, emcy: EmcyProducer) -> None:
        self._emcy = emcy

    def take(self, event: CanEvent) -> None:
        """Raise or clear the error of an event."""
        emcy = self._emcy
        if event is CanEvent.PASSIVE:
            emcy.raise_error(PASSIVE, COMMUNICATION)
        elif event is CanEvent.ACTIVE:
            emcy.clear_error(PASSIVE)
        elif event is CanEvent.OVERRUN:
            emcy.raise_error(OVERRUN, COMMUNICATION)
        elif event is CanEvent.SENT_ALL:
            emcy.clear_error(OVERRUN)
        elif event is CanEvent.RECOVERED:
            emcy.raise_error(RECOVERED, COMMUNICATION)
            emcy.clear_error(RECOVERED)
            emcy.clear_error(PASSIVE)
