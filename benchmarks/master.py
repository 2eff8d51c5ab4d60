"""Frames of a master, and the demand that they have their effect."""

import struct

from hil_bench.canopen_device.frame import Frame

TICK = 1_000_000  # [ns]
SYNC = Frame(0x080)
NMT_START = Frame(0x000, b"\x01\x00")


def upload(node_id: int, index: int, subindex: int) -> Frame:
    """Return an SDO request to read an object."""
    return Frame(0x600 + node_id, struct.pack("<BHB4x", 0x40, index, subindex))


def download(node_id: int, index: int, subindex: int, raw: bytes) -> Frame:
    """Return an SDO request to write an object of one to four bytes."""
    command = 0x23 | (4 - len(raw)) << 2
    return Frame(
        0x600 + node_id, struct.pack("<BHB", command, index, subindex) + raw.ljust(4, b"\0")
    )


def demand(expected: int, found: int, what: str) -> None:
    """End the run where something other than intended was measured.

    Raises:
        SystemExit: it was.
    """
    if expected != found:
        raise SystemExit(f"{what}: {found} where {expected} are right; nothing was measured")
