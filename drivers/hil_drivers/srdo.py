"""The receiver of an SRDO (EN 50325-5): two frames, of which the second has every bit inverted."""

import struct
from binascii import crc_hqx
from dataclasses import dataclass

from canopen.objectdictionary import ODVariable, datatypes

from hil_drivers.device import milliseconds
from hil_drivers.errors import DeviceMismatchError, StaleValueError
from hil_drivers.network import Network
from hil_drivers.node import Node, object_name
from hil_drivers.pdo import MappedObject

_PARAMETERS, _MAPPING, _VALID, _SIGNATURES = 0x1301, 0x1381, 0x13FE, 0x13FF
_SENT, _IS_VALID = 1, 0xA5


@dataclass
class SrdoCounters:
    """Counters of the frames of an SRDO.

    Attributes:
        accepted: pairs that agree and came in time.
        missing: plain frames without an inverted one before the next.
        mismatched: pairs that do not agree bit by bit, or have a wrong length.
        late: pairs whose second frame came later than the SRVT.
    """

    accepted: int = 0
    missing: int = 0
    mismatched: int = 0
    late: int = 0


class SafetyInput:
    """An SRDO that a device sends.

    Its values are those of the last pair of frames that agreed; they are refused once the
    safeguard cycle time is over, whatever was the reason that no other pair came.

    Args:
        network: the network that the device is on.
        node: the device.
        number: of the SRDO.

    Attributes:
        counters: what came of its frames.
    """

    def __init__(self, network: Network, node: Node, number: int = 1) -> None:
        self.counters = SrdoCounters()
        self._network = network
        self._node = node
        self._number = number
        self._sct = self._srvt = 0.0
        self._objects: list[MappedObject] = []
        self._length = 0
        self._plain: bytes | None = None
        self._plain_at = self._valid_at = -float("inf")
        self._data = b""

    def setup(self, *, refresh: float = 0.02, sct: float = 0.05, srvt: float = 0.02) -> None:
        """Have the device send, sign its configuration, and begin to listen.

        The device must not be OPERATIONAL.

        Args:
            refresh: time between two pairs [s].
            sct: longest time between two pairs that agree [s].
            srvt: longest time between the frames of a pair [s].

        Raises:
            ValueError: a time is out of range, or the refresh time is longer than the SCT.
            DeviceMismatchError: the inverted frame carries other objects than the plain one.
        """
        if not 0.0 < refresh < sct:
            raise ValueError(f"refresh {refresh} s: more than 0 and less than the SCT is right")
        self._sct, self._srvt = sct, srvt
        index, mapping = _PARAMETERS + self._number - 1, _MAPPING + self._number - 1
        node = self._node
        node.write(index, 1, _SENT)
        node.write(index, 2, milliseconds("refresh time", refresh))
        words = [
            node.read_integer(mapping, sub) for sub in range(1, node.read_integer(mapping) + 1)
        ]
        if words[::2] != words[1::2]:
            raise DeviceMismatchError(
                f"{node}: {object_name(mapping)} maps other objects inverted than plain; "
                "the same ones in pairs are right"
            )
        self._objects = [MappedObject.from_entry(word) for word in words[::2]]
        self._length = sum(mapped.bits for mapped in self._objects) // 8
        identifiers = [node.read_integer(index, sub) for sub in (5, 6)]
        node.write(_SIGNATURES, self._number, self._signature(index, identifiers, words))
        node.write(_VALID, 0, _IS_VALID)
        for identifier, take in zip(
            identifiers, (self._take_plain, self._take_inverted), strict=True
        ):
            self._network.subscribe(identifier, take)

    def value(self, index: int, subindex: int = 0) -> int | float:
        """Return the value of a mapped object, as the device counts it.

        Raises:
            StaleValueError: no pair of frames agreed within the SCT.
            KeyError: the SRDO does not carry the object, or it is no number.
        """
        age = self._network.now() - self._valid_at
        if age > self._sct:
            raise StaleValueError(
                f"{self._node}: SRDO {self._number} has no valid pair of frames for "
                f"{1000 * age:.1f} ms; at most {1000 * self._sct:g} ms are right"
            )
        start = 0
        for mapped in self._objects:
            end = start + mapped.bits // 8
            if mapped.key == (index, subindex):
                data_type = self._node.variable(index, subindex).data_type
                if data_type not in datatypes.NUMBER_TYPES:
                    break
                codec = ODVariable.STRUCT_TYPES[data_type]
                value: int | float = codec.unpack(self._data[start:end])[0]
                return value
            start = end
        raise KeyError(f"SRDO {self._number} carries no number {object_name(index, subindex)}")

    def _signature(self, index: int, identifiers: list[int], words: list[int]) -> int:
        """Return the CRC-16 (CCITT, from 0) of parameters and mapping."""
        head = [self._node.read_integer(index, sub) for sub in (1, 2, 3)]
        raw = struct.pack("<BHBIIB", *head, *identifiers, len(words))
        for sub, word in enumerate(words, start=1):
            raw += struct.pack("<BI", sub, word)
        return crc_hqx(raw, 0)

    def _take_plain(self, data: bytes, now: float) -> bool:
        if self._plain is not None:
            self.counters.missing += 1
        self._plain, self._plain_at = data, now
        return True

    def _take_inverted(self, data: bytes, now: float) -> bool:
        plain, self._plain = self._plain, None
        if plain is None:
            return True
        if now - self._plain_at > self._srvt:
            self.counters.late += 1
        elif len(plain) != self._length or bytes(byte ^ 0xFF for byte in data) != plain:
            self.counters.mismatched += 1
        else:
            self._data, self._valid_at = plain, now
            self.counters.accepted += 1
        return True
