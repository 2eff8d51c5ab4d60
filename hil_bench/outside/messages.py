"""Frames as python-can's messages."""

import can

from hil_bench.canopen_device.frame import BRS, ESI, FDF, Frame, make_frame
from hil_bench.frame import CLASSICAL_DATA, FD_LENGTHS

_STANDARD_ID_MAX = 0x7FF
_EXTENDED_ID_MAX = 0x1FFF_FFFF


def frame_of(message: can.Message) -> Frame | None:
    """Return the message as a `Frame`, or None where it is no data or remote frame."""
    fd = fd_of(message) if message.is_fd else 0
    if message.is_error_frame or has_bad_length(message):
        return None
    limit = _EXTENDED_ID_MAX if message.is_extended_id else _STANDARD_ID_MAX
    if not 0 <= message.arbitration_id <= limit:
        return None
    is_remote = message.is_remote_frame and not fd
    data = b"" if is_remote else bytes(message.data)
    return make_frame(
        Frame, (message.arbitration_id, data, is_remote, message.is_extended_id, 0, fd)
    )


def fd_of(message: can.Message) -> int:
    """Return the flags of `Frame.fd` that a message has, 0 for a classical one."""
    if not message.is_fd:
        return 0
    return FDF | BRS * message.bitrate_switch | ESI * message.error_state_indicator


def has_bad_length(message: can.Message) -> bool:
    """Return True if a message has so many bytes that no DLC says it, or another DLC than these."""
    length = len(message.data)
    if message.is_fd:
        return length not in FD_LENGTHS or message.dlc != length
    return length > CLASSICAL_DATA


def message_of(frame: Frame) -> can.Message:
    """Return the frame as python-can's message."""
    message = can.Message(
        arbitration_id=frame.can_id,
        data=frame.data,
        is_remote_frame=frame.is_remote,
        is_extended_id=frame.is_extended,
    )
    if fd := frame.fd:
        message.is_fd = True
        message.bitrate_switch, message.error_state_indicator = fd & BRS != 0, fd & ESI != 0
    return message
