"""LSS slave (CiA 305, layer setting services): node-ID and bit timing over the bus.

A device is found by its LSS address, the four entries of 0x1018. In the LSS state CONFIGURATION it
takes a new node-ID and bit timing, keeps them, or tells what it is; in WAITING it listens to what
selects, identifies or scans. A new node-ID counts after the next reset of the communication; a
device that had none (node-ID 255) takes it, and boots, when it returns to WAITING.

=========  ================================================  ==========================  =========
specifier  request                                           LSS state                   answer
=========  ================================================  ==========================  =========
0x04       switch state global                               both                        none
0x40..43   switch state selective                            WAITING                     0x44
0x11       configure node-ID                                 CONFIGURATION               0x11
0x13       configure bit timing                              CONFIGURATION               0x13
0x15       activate bit timing                               CONFIGURATION               none
0x17       store configuration                               CONFIGURATION               0x17
0x5A..5D   inquire identity                                  CONFIGURATION               the same
0x5E       inquire node-ID                                   CONFIGURATION               0x5E
0x46..4B   identify remote slave                             both                        0x4F
0x4C       identify non-configured remote slave              both, node-ID 255           0x50
0x51       fastscan                                          WAITING, node-ID 255        0x4F
=========  ================================================  ==========================  =========
"""

import struct
from collections import deque
from typing import Final

from hil_bench.canopen_device.agenda import MILLISECOND, NEVER, Agenda
from hil_bench.canopen_device.errors import StorageError
from hil_bench.canopen_device.frame import Emit, Frame
from hil_bench.canopen_device.nmt import UNCONFIGURED
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.service import NodeCounters, Service
from hil_bench.canopen_device.storage import ParameterStore

LSS_REQUEST: Final = 0x7E5
"""Identifier from the LSS master to its slaves."""
LSS_RESPONSE: Final = 0x7E4
"""Identifier from a slave to the LSS master."""

_QUEUE_LENGTH: Final = 64
_BIT_TIMINGS: Final = frozenset({0, 1, 2, 3, 4, 6, 7, 8})
"""Indices of the standard table: 1000, 800, 500, 250, 125, (reserved), 50, 20, 10 kbit/s."""

_SWITCH_GLOBAL: Final = 0x04
_CONFIGURE_NODE_ID: Final = 0x11
_CONFIGURE_BIT_TIMING: Final = 0x13
_ACTIVATE_BIT_TIMING: Final = 0x15
_STORE: Final = 0x17
_SELECT: Final = range(0x40, 0x44)
_SELECTED: Final = 0x44
_IDENTIFY: Final = range(0x46, 0x4C)
_IDENTIFY_UNCONFIGURED: Final = 0x4C
_IDENTIFIED: Final = 0x4F
_UNCONFIGURED_IDENTIFIED: Final = 0x50
_FASTSCAN: Final = 0x51
_INQUIRE_IDENTITY: Final = range(0x5A, 0x5E)
_INQUIRE_NODE_ID: Final = 0x5E

_WAITING: Final = 0
_CONFIGURATION: Final = 1
_FASTSCAN_BEGIN: Final = 0x80
_OUT_OF_RANGE: Final = 1
_MEDIA_ERROR: Final = 2
_IMPLEMENTATION_ERROR: Final = 0xFF
_WORD: Final = 0xFFFFFFFF

_NUMBER: Final = struct.Struct("<BI3x")
_SCAN: Final = struct.Struct("<BIBBB")
_SHORT: Final = struct.Struct("<BB6x")


class LssSlave(Service):
    """The LSS side of one device.

    Attributes:
        is_available: whether the device has the four entries of 0x1018 that LSS needs.
        pending_node_id: the node-ID after the next reset of the communication; 255 for none.
        must_boot: whether a device without node-ID got one, and is to boot.
        silent_until: end of the silence that a switch of the bit timing asks for [ns].
    """

    def __init__(
        self,
        object_dictionary: ObjectDictionary,
        node_id: int,
        store: ParameterStore,
        agenda: Agenda,
        counters: NodeCounters,
    ) -> None:
        self.is_available = all(object_dictionary.find(0x1018, sub) for sub in range(1, 5))
        self.pending_node_id = node_id
        self.must_boot = False
        self.silent_until = 0
        self._object_dictionary = object_dictionary
        self._store = store
        self._agenda = agenda
        self._counters = counters
        self._bit_timing = store.bit_timing
        self._answers: deque[bytes] = deque()
        self.reset(node_id)

    def reset(self, node_id: int) -> None:
        """Return to WAITING; `node_id` is in force now."""
        self.must_boot = False
        self._node_id = node_id
        self._is_configuring = False
        self._selected = 0
        self._identified = 0
        self._scanned = 0

    def receive(self, frame: Frame, now: int) -> None:
        """Take a message of the LSS master."""
        if not self._counters.is_data(frame):
            return
        if len(frame.data) != _NUMBER.size:
            self._counters.malformed_lss += 1
        elif len(self._answers) >= _QUEUE_LENGTH:
            self._counters.dropped_lss_requests += 1
        else:
            self._dispatch(frame.data, now)

    def serve(self, now: int, emit: Emit) -> int:  # noqa: ARG002 - answers wait for nothing
        """Send the answers."""
        while self._answers:
            emit(Frame(LSS_RESPONSE, self._answers.popleft()))
        return NEVER

    def _dispatch(self, data: bytes, now: int) -> None:
        specifier, number = _NUMBER.unpack(data)
        if specifier == _SWITCH_GLOBAL:
            self._switch_global(data[1])
        elif specifier in _IDENTIFY:
            self._identify(specifier - _IDENTIFY.start, number)
        elif specifier == _IDENTIFY_UNCONFIGURED:
            if self._node_id == UNCONFIGURED:
                self._answer(_SHORT.pack(_UNCONFIGURED_IDENTIFIED, 0))
        elif self._is_configuring:
            self._configure(specifier, data, now)
        elif specifier in _SELECT:
            self._select(specifier - _SELECT.start, number)
        elif specifier == _FASTSCAN and self._node_id == UNCONFIGURED:
            self._scan(data)

    def _configure(self, specifier: int, data: bytes, now: int) -> None:
        """Take what only the state CONFIGURATION knows."""
        if specifier == _CONFIGURE_NODE_ID:
            self._configure_node_id(data[1])
        elif specifier == _CONFIGURE_BIT_TIMING:
            self._configure_bit_timing(data[1], data[2])
        elif specifier == _ACTIVATE_BIT_TIMING:
            self._activate_bit_timing(int.from_bytes(data[1:3], "little"), now)
        elif specifier == _STORE:
            self._answer_store()
        elif specifier in _INQUIRE_IDENTITY:
            part = self._address(specifier - _INQUIRE_IDENTITY.start)
            self._answer(_NUMBER.pack(specifier, part))
        elif specifier == _INQUIRE_NODE_ID:
            self._answer(_SHORT.pack(specifier, self._node_id))

    def _answer(self, data: bytes) -> None:
        self._answers.append(data)
        self._agenda.bring_forward(0)

    def _address(self, part: int) -> int:
        """Vendor-ID, product code, revision number or serial number."""
        return self._object_dictionary.number(0x1018, part + 1)

    def _switch_global(self, mode: int) -> None:
        """Switch to a mode; those that CiA 305 reserves are none, and change nothing."""
        if mode in {_WAITING, _CONFIGURATION}:
            self._switch(is_configuring=mode == _CONFIGURATION)
        else:
            self._counters.malformed_lss += 1

    def _switch(self, *, is_configuring: bool) -> None:
        has_node_id = self.pending_node_id != UNCONFIGURED
        if self._is_configuring and not is_configuring:
            self.must_boot = self._node_id == UNCONFIGURED and has_node_id
        self._is_configuring = is_configuring
        self._selected = self._scanned = 0

    def _select(self, part: int, number: int) -> None:
        """Enter CONFIGURATION when all four parts of the LSS address came and were right."""
        is_right = part in {0, self._selected} and number == self._address(part)
        self._selected = part + 1 if is_right else 0
        if self._selected == len(_SELECT):
            self._switch(is_configuring=True)
            self._answer(_SHORT.pack(_SELECTED, 0))

    def _identify(self, step: int, number: int) -> None:
        """Answer when vendor and product are right, and revision and serial number in range."""
        part = (0, 1, 2, 2, 3, 3)[step]
        address = self._address(part)
        if part < 2:
            is_right = number == address
        else:
            is_right = number <= address if step % 2 == 0 else number >= address
        self._identified = step + 1 if is_right and step in {0, self._identified} else 0
        if self._identified == len(_IDENTIFY):
            self._identified = 0
            self._answer(_SHORT.pack(_IDENTIFIED, 0))

    def _scan(self, data: bytes) -> None:
        """Answer while the bits from `bit_check` up are those of the part being scanned."""
        _, number, bit_check, part, next_part = _SCAN.unpack(data)
        if bit_check == _FASTSCAN_BEGIN:
            self._scanned = 0
            self._answer(_SHORT.pack(_IDENTIFIED, 0))
            return
        if bit_check > 31 or part > 3 or next_part > 3 or part != self._scanned:
            return
        if (number ^ self._address(part)) & _WORD << bit_check & _WORD:
            return
        self._answer(_SHORT.pack(_IDENTIFIED, 0))
        if bit_check == 0:
            self._scanned = next_part
            if next_part < part:
                self._switch(is_configuring=True)

    def _configure_node_id(self, node_id: int) -> None:
        is_possible = 1 <= node_id <= 127 or node_id == UNCONFIGURED
        if is_possible:
            self.pending_node_id = node_id
        self._answer(_SHORT.pack(_CONFIGURE_NODE_ID, 0 if is_possible else _OUT_OF_RANGE))

    def _configure_bit_timing(self, table: int, index: int) -> None:
        is_possible = table == 0 and index in _BIT_TIMINGS
        if is_possible:
            self._bit_timing = index
        self._answer(_SHORT.pack(_CONFIGURE_BIT_TIMING, 0 if is_possible else _OUT_OF_RANGE))

    def _activate_bit_timing(self, delay: int, now: int) -> None:
        """Fall silent before and after the switch, for `delay` [ms] each.

        The bench's interface keeps its bit rate: a virtual device has none of its own.
        """
        if self._bit_timing is not None:
            self.silent_until = now + 2 * delay * MILLISECOND

    def _answer_store(self) -> None:
        error = 0
        if not self._store.is_enabled:
            error = _IMPLEMENTATION_ERROR
        else:
            try:
                self._store.store_layer_settings(self.pending_node_id, self._bit_timing)
            except StorageError:
                error = _MEDIA_ERROR
        self._answer(_SHORT.pack(_STORE, error))
