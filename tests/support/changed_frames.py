"""Frames that are changed on their way, as a mistake of a device's firmware would change them.

Each function makes a defect: of a frame the frames that take its place. Data are given in hex.
"""

import struct

REQUEST, ANSWER, HEARTBEAT, EMCY, LSS = 0x605, 0x585, 0x705, 0x085, 0x7E5


def altered(can_id, change):
    """Data of an identifier are changed; None is not sent at all."""

    def defect(frame):
        data = change(frame.data) if frame.can_id == can_id else frame.data
        return [] if data is None else [frame._replace(data=data)]

    return defect


def lost(can_id, beginning=""):
    """Frames of an identifier whose data begin so are lost."""
    begins = bytes.fromhex(beginning)
    return altered(can_id, lambda data: None if data.startswith(begins) else data)


def begun_otherwise(can_id, beginning, instead):
    """Data that begin so begin otherwise."""
    begins, other = bytes.fromhex(beginning), bytes.fromhex(instead)
    return altered(
        can_id, lambda data: other + data[len(other) :] if data.startswith(begins) else data
    )


def aborted_otherwise(code, *instead_of, where=lambda _data: True):
    """SDO transfers are aborted with one code instead of others."""
    wrong, right = struct.pack("<I", code), [struct.pack("<I", other) for other in instead_of]

    def change(data):
        is_it = data[:1] == b"\x80" and data[4:] in right and where(data)
        return data[:4] + wrong if is_it else data

    return altered(ANSWER, change)
