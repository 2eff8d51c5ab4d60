"""Bits of a frame on the bus, one by one."""

from typing import Final

from hil_bench.canopen_device.frame import BRS, ESI, Frame
from hil_bench.frame import (
    ACK_TO_NEXT,
    FD_DLC,
    FD_EXTENSION,
    FD_HEAD,
    FD_LENGTHS,
    MOST_OF_CRC17,
    fd_crc_bits,
)

# The length of a frame on the bus, to the bit (ISO 11898-1).
#
# A classical frame has a start bit, the identifier with its control bits, the data and a CRC of
# 15 bits; after five equal bits of these comes one of the other value. Ten bits end the frame
# without stuffing, and three stand between two frames.
#
# In a frame of CAN FD stuffing ends with the data. The count of stuff bits and a CRC of 17 or 21
# bits follow, with a stuff bit before the first of these and after each four. With BRS, the bits
# behind it up to the delimiter of the CRC have the data bit rate.

INTERMISSION: Final = 3
"""Bits between two frames."""

ENDING: Final = 10
"""CRC delimiter, acknowledgement with its delimiter, end of frame."""

_CRC_BITS: Final = 15
_POLYNOMIAL: Final = 0x4599
_CRC_MASK: Final = 0x7FFF
_STUFFED_AFTER: Final = 5


def exact_bits(frame: Frame) -> int:
    """Return the bits of a frame with its stuff bits, and of the intermission after it."""
    if frame.fd:
        return sum(exact_fd_bits(frame))
    word, length = _with_crc(frame)
    return length + _stuff_count(word, length, _START)[1] + ENDING + INTERMISSION


def exact_fd_bits(frame: Frame) -> tuple[int, int]:
    """Return the bits of a frame of CAN FD without those from ESI to the CRC delimiter, and these.

    The second ones have the data bit rate where BRS is set. The first ones count the intermission.
    """
    head, size, data, length = _fd_words(frame)
    state, stuffed = _stuff_count(head, size, _START)
    slow = size + stuffed + ACK_TO_NEXT
    # The fixed stuff bit of the CRC field stands where one behind the last bit would be.
    _, stuffed = _stuff_count(data >> 1, length - 1, state)
    return slow, length + stuffed + fd_crc_bits(len(frame.data))


def fast_place(frame: Frame) -> int:
    """Return the place of the first bit at the data bit rate in a frame with BRS."""
    head, size, _, _ = _fd_words(frame)
    return size + _stuff_count(head, size, _START)[1]


def stuffed_bits(frame: Frame) -> list[int]:
    """Return the bits of a frame from its start to the end of the CRC, with stuff bits."""
    if frame.fd:
        return _stuffed_fd_bits(frame)
    return _stuffed(*_with_crc(frame))


def _stuff_count(word: int, length: int, state: int) -> tuple[int, int]:
    """Return the state after some bits, and how many stuff bits are among them."""
    count, place = 0, length - 8
    while place >= 0:
        state, stuffed = _STEPS[8][state << 8 | word >> place & 0xFF]
        count += stuffed
        place -= 8
    rest = place + 8
    if rest:
        state, stuffed = _STEPS[rest][state << rest | word & (1 << rest) - 1]
        count += stuffed
    return state, count


def _stuffed(word: int, length: int) -> list[int]:
    """Return bits with stuff bits."""
    bits: list[int] = []
    last, run = -1, 0
    for place in range(length - 1, -1, -1):
        bit = word >> place & 1
        run = run + 1 if bit == last else 1
        last = bit
        bits.append(bit)
        if run == _STUFFED_AFTER:
            last, run = 1 - bit, 1
            bits.append(last)
    return bits


def _fd_words(frame: Frame) -> tuple[int, int, int, int]:
    """Return the bits of a frame of CAN FD up to BRS, and from ESI on, with their counts."""
    can_id, data, _, is_extended, _, fd = frame
    head = can_id << 2  # 11 bits, RRS and IDE dominant
    if is_extended:  # 11 bits, SRR and IDE recessive, 18 bits, RRS dominant
        head = ((can_id >> 18) << 2 | 0b11) << 19 | (can_id & 0x3FFFF) << 1
    head = head << 3 | 0b100 | (fd & BRS != 0)  # FDF recessive, a reserved bit dominant
    length = len(data)
    word = (fd & ESI != 0) << 4 | FD_LENGTHS.index(length)
    size = FD_HEAD + FD_EXTENSION * is_extended
    return head, size, word << 8 * length | int.from_bytes(data, "big"), FD_DLC + 8 * length


def _stuffed_fd_bits(frame: Frame) -> list[int]:
    head, size, data, length = _fd_words(frame)
    plain = size + length
    word = head << length | data
    bits = [*_stuffed(word >> 1, plain - 1), word & 1]
    stuffed = (len(bits) - plain) % 8
    gray = stuffed ^ stuffed >> 1
    count = [*(gray >> place & 1 for place in (2, 1, 0)), gray.bit_count() & 1]
    width, polynomial = (17, 0x1685B) if len(frame.data) <= MOST_OF_CRC17 else (21, 0x102899)
    crc = 1 << width - 1
    for bit in (*bits, *count):
        is_set = crc >> width - 1 ^ bit
        crc = (crc << 1 ^ polynomial * is_set) & (1 << width) - 1
    for place, bit in enumerate((*count, *(crc >> place & 1 for place in reversed(range(width))))):
        if place % 4 == 0:
            bits.append(1 - bits[-1])
        bits.append(bit)
    return bits


def _with_crc(frame: Frame) -> tuple[int, int]:
    """Return start bit to CRC as one number, and how many bits it has."""
    can_id, data, is_remote, is_extended, _, _ = frame
    if is_extended:  # 11 bits, SRR and IDE recessive, 18 bits, RTR, two reserved bits
        word = (can_id >> 18) << 2 | 0b11
        word = ((word << 18 | can_id & 0x3FFFF) << 1 | is_remote) << 2
        length = 39
    else:  # 11 bits, RTR, IDE and a reserved bit dominant
        word, length = (can_id << 1 | is_remote) << 2, 19
    word = word << 4 | len(data)
    crc = 0
    for place in (32, 24, 16, 8, 0):  # zeros in front change nothing: the CRC begins with zeros
        crc = crc << 8 & _CRC_MASK ^ _CRC_STEPS[crc >> 7 ^ word >> place & 0xFF]
    for byte in data:
        crc = crc << 8 & _CRC_MASK ^ _CRC_STEPS[crc >> 7 ^ byte]
    word = word << 8 * len(data) | int.from_bytes(data, "big")
    return word << _CRC_BITS | crc, length + 8 * len(data) + _CRC_BITS


def _crc_step(byte: int) -> int:
    crc = byte << 7
    for _ in range(8):
        crc = (crc << 1 ^ _POLYNOMIAL) if crc & 0x4000 else crc << 1
    return crc & _CRC_MASK


_CRC_STEPS: Final = tuple(map(_crc_step, range(256)))
"""What each byte at the head of the register leaves there."""

_START: Final = 0
"""State of stuffing before a frame: no bit yet. Others: last bit and length of its run."""


def _stuffing_step(state: int, bits: int, count: int) -> tuple[int, int]:
    """Return the state after some bits, and how many stuff bits are among them.

    A state is 0, or 1 to 4 after so many dominant bits, or 5 to 8 after one to four recessive ones.
    """
    stuffed = 0
    for place in range(count - 1, -1, -1):
        bit = bits >> place & 1
        is_same = state and bit == (state > 4)
        run = (state - 1) % 4 + 2 if is_same else 1
        if run == _STUFFED_AFTER:  # the stuff bit begins the next run
            stuffed, bit, run = stuffed + 1, 1 - bit, 1
        state = 4 * bit + run
    return state, stuffed


_STEPS: Final = tuple(
    tuple(_stuffing_step(state, bits, count) for state in range(9) for bits in range(1 << count))
    if count
    else ()
    for count in range(9)
)
"""`_stuffing_step` of so many bits, by the state and the bits behind it."""
