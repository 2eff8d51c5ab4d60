"""The receiver's check of PDOs with a rolling counter and a checksum.

Behind the mapped bytes come the counter, 0 to 255 and round, and the CRC-8 of SAE J1850 of
identifier (two bytes, the low one first), mapped bytes and counter.
"""

from dataclasses import dataclass

_POLYNOMIAL = 0x1D
SEAL_BYTES = 2


def crc8(data: bytes) -> int:
    """Return the CRC-8 of SAE J1850: polynomial 0x1D, initial value and final XOR 0xFF."""
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ (_POLYNOMIAL if crc & 0x80 else 0)) & 0xFF
    return crc ^ 0xFF


@dataclass
class Protection:
    """Counters of the protected frames of one PDO.

    Attributes:
        cob_id: identifier of the PDO.
        accepted: frames whose checksum and counter are right.
        wrong_crc: refused, since the checksum or the length is wrong.
        repeated: refused, since the counter did not move.
        lost: frames between accepted ones that never came, by their counters.
    """

    cob_id: int
    accepted: int = 0
    wrong_crc: int = 0
    repeated: int = 0
    lost: int = 0
    _counter: int | None = None

    def open(self, data: bytes) -> bytes | None:
        """Return the mapped bytes of a frame; None where it is refused."""
        if (
            len(data) < SEAL_BYTES
            or crc8(self.cob_id.to_bytes(2, "little") + data[:-1]) != data[-1]
        ):
            self.wrong_crc += 1
            return None
        counter = data[-SEAL_BYTES]
        step = 1 if self._counter is None else (counter - self._counter) & 0xFF
        if step == 0:
            self.repeated += 1
            return None
        self._counter = counter
        self.lost += step - 1
        self.accepted += 1
        return data[:-SEAL_BYTES]
