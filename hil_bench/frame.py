"""Frames on the buses of a bench: which of the buses, and how long each is taken."""

from typing import Final

from hil_bench.canopen_device.frame import BRS, Frame

BUS_SHIFT = 11

FD_LENGTHS: Final = (*range(9), 12, 16, 20, 24, 32, 48, 64)
"""Data bytes that a frame of CAN FD may have, by its DLC (ISO 11898-1)."""

CLASSICAL_DATA: Final = 8
"""Most data bytes of a classical frame."""

ERROR_FLAG = 0x2000_0000
"""Bit of the identifier of an error frame, as SocketCAN has it: `linux/can/error.h` says what the
other bits and its eight bytes mean. Recordings and the eyes know such frames; no device ever gets
one."""


def address_of(can_id: int, bus: int) -> int:
    """Return an 11-bit identifier and the number of its bus as one number; on bus 0 they are one.

    It is ``frame.can_id | frame.bus << BUS_SHIFT``, and written so where each frame passes.
    """
    return can_id | bus << BUS_SHIFT


def is_error_frame(frame: Frame) -> bool:
    """Return True if a frame is an adapter's report of an error."""
    return frame.can_id >= ERROR_FLAG and not frame.is_extended


def priority(frame: Frame) -> int:
    """Return the key of arbitration, the lowest first: the bits up to the control field.

    A data frame goes before a frame of CAN FD of its identifier, that before a remote frame, and
    one of 11 bits before one of 29 bits that begins with them.
    """
    is_fd = frame.fd != 0
    if frame.is_extended:
        base, rest = frame.can_id >> 18, frame.can_id & 0x3FFFF
        return (base << 2 | 3) << 20 | rest << 2 | frame.is_remote << 1 | is_fd
    return (frame.can_id << 2 | frame.is_remote << 1) << 20 | is_fd


def frame_bits(length: int, *, is_extended: bool = False) -> float:
    """Return the bits that a frame takes on the bus, with half of the most stuff bits it can have.

    A data frame with an 11-bit identifier has 44 bits and 8 a byte, and 3 between frames; of these,
    34 and 8 a byte are stuffed, at most one bit after each four (ISO 11898-1).

    Args:
        length: data bytes.
        is_extended: whether the identifier has 29 bits.
    """
    head = 20 if is_extended else 0
    stuffed = 34 + head + 8 * length
    return 47 + head + 8 * length + (stuffed - 1) / 4 / 2


FRAME_BITS = tuple(frame_bits(length) for length in range(9))
"""`frame_bits` of a frame with an 11-bit identifier, by its length."""


def bits_of(frame: Frame, speedup: float = 1.0) -> float:
    """Return `frame_bits` of a frame, those of a frame of CAN FD likewise.

    Up to and with BRS, and from the acknowledgement on, a frame of CAN FD has 29 bits with an
    11-bit identifier; between them are ESI, DLC, data, stuff count, CRC with its fixed stuff bits
    and its delimiter, at the data bit rate (ISO 11898-1; `linux/can/length.h` counts the fields).

    Args:
        frame: the frame.
        speedup: data bit rate over bit rate; the bits are those of the bit rate.
    """
    length, is_extended = len(frame.data), frame.is_extended
    if not frame.fd:
        return frame_bits(length, is_extended=is_extended)
    head = FD_HEAD + FD_EXTENSION * is_extended
    data = FD_DLC + 8 * length
    slow = head + ACK_TO_NEXT + (head - 4) / 4 / 2
    fast = data + fd_crc_bits(length) + (data - 1) / 4 / 2
    return slow + (fast / speedup if frame.fd & BRS else fast)


FD_HEAD: Final = 17
"""Bits of a frame of CAN FD with an 11-bit identifier, from its start to BRS."""

FD_EXTENSION: Final = 19
"""How many more those of a 29-bit identifier are."""

FD_DLC: Final = 5
"""ESI and DLC."""

ACK_TO_NEXT: Final = 12
"""Acknowledgement with its delimiter, end of frame, intermission."""


def fd_crc_bits(length: int) -> int:
    """Return the bits of the CRC field of CAN FD: stuff count, CRC, fixed stuff bits, delimiter."""
    return 4 + (17 + 6 if length <= MOST_OF_CRC17 else 21 + 7) + 1


MOST_OF_CRC17: Final = 16
"""Data bytes up to which a frame of CAN FD has the CRC of 17 bits; above, it has that of 21."""
