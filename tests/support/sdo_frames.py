"""Frames of SDO transfers, written by the tables of CiA 301 and not by our own server."""

import struct

from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import LoggedFrame

MS = 1_000_000


def heard(*frames, begin=0, step=MS):
    """Return frames as a log has them, one each `step` [ns]."""
    return [LoggedFrame(frame, begin + number * step, None) for number, frame in enumerate(frames)]


def request(node_id, data):
    return Frame(0x600 + node_id, bytes.fromhex(data).ljust(8, b"\0"))


def answer(node_id, data):
    return Frame(0x580 + node_id, bytes.fromhex(data).ljust(8, b"\0"))


def place(index, subindex):
    return struct.pack("<HB", index, subindex)


def upload(node_id, index, subindex, value):
    """An expedited upload: 0x40, then 0x43 and the like with n in bits 2 and 3."""
    command = 0x43 | (4 - len(value)) << 2
    return [
        Frame(0x600 + node_id, b"\x40" + place(index, subindex) + bytes(4)),
        Frame(0x580 + node_id, bytes([command]) + place(index, subindex) + value.ljust(4, b"\0")),
    ]


def download(node_id, index, subindex, value):
    """An expedited download: 0x23 and the like, then 0x60."""
    command = 0x23 | (4 - len(value)) << 2
    return [
        Frame(0x600 + node_id, bytes([command]) + place(index, subindex) + value.ljust(4, b"\0")),
        Frame(0x580 + node_id, b"\x60" + place(index, subindex) + bytes(4)),
    ]
