"""Frames on the buses of a bench: which of the buses, and how long each is taken."""

from hil_bench.canopen_device.frame import Frame

BUS_SHIFT = 11


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
    """Return whether a frame is what an adapter reports of an error."""
    return frame.can_id >= ERROR_FLAG and not frame.is_extended


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
