"""The blocks of a measurement data file, as far as recordings use them (ASAM MDF 4.1).

Every block is: identifier, length, count of links, links (addresses in the file, 0 for none), data;
all little-endian, at addresses that are multiples of 8. A recording has a data group for the
signals, one for the data frames and one for the remote frames of the bus (ASAM MDF 4.1 bus logging,
"CAN_DataFrame", "CAN_RemoteFrame"), and with the first error frame one for those
("CAN_ErrorFrame"), with the first frame of CAN FD one more "CAN_DataFrame". Each group's records
stand in compressed, transposed blocks (DZ), chained by data lists (DL).
"""

import struct
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

HEADER = struct.Struct("<4sIQQ")
"""Identifier, reserved, length with header and links, count of links."""

IDENTIFICATION = struct.Struct("<8s8s8s4sH30sHH")
"""File, version as text, program, reserved, version, reserved, what is unfinalised (twice)."""

IDENTIFICATION_SIZE = 64
"""Size of that block, and address of the HD block after it."""

VERSION = 410

HD_DATA = struct.Struct("<qhhBBBBdd")
"""Start time [ns since 1970], zone and summer time [min], flags, class, flags, angle, distance."""

FH_DATA = struct.Struct("<qhhB3s")
"""Time of the change [ns since 1970], zone and summer time [min], flags of time."""

DG_DATA = struct.Struct("<B7s")
"""Size of record identifiers."""

CG_DATA = struct.Struct("<QQHH4sII")
"""Record identifier, count of records, flags, path separator, reserved, size of a record, of its
invalidation bits."""

CN_DATA = struct.Struct("<BBBBIIIIBBH6d")
"""Type, synchronisation, data type, bit offset, byte offset, bits, flags, invalidation bit,
precision, reserved, attachments, ranges."""

SI_DATA = struct.Struct("<BBB5s")
"""Type of source, type of bus, flags."""

HL_DATA = struct.Struct("<HB5s")
"""Flags, type of compression."""

DL_DATA = struct.Struct("<B3sIQ")
"""Flags, reserved, count of blocks (here 1), offset of its first byte in the group's data."""

DZ_DATA = struct.Struct("<2sBBIQQ")
"""Identifier of the compressed block, type, reserved, record size, length before, length after."""

TRANSPOSED = 1
"""Type of compression: deflate after the records' bytes were transposed."""

MASTER, VALUE = 2, 0
"""Types of channel."""

TIME_SYNCHRONISED = 1

UNSIGNED, FLOAT, BYTES = 0, 4, 10
"""Data types of a channel, little-endian."""

BUS_EVENT, PLAIN_BUS_EVENT = 0x2, 0x4
"""Flags of a channel group."""

CHANNEL_BUS_EVENT = 1 << 10
"""Flag of a channel."""

SOURCE_BUS, BUS_CAN = 2, 2

DATA_FRAME, REMOTE_FRAME, ERROR_FRAME = "CAN_DataFrame", "CAN_RemoteFrame", "CAN_ErrorFrame"
"""Names of the bus groups' channels, as the standard gives them."""

SENT, RECEIVED = 1, 0
"""Values of their field Dir."""

_HEAD_FIELDS = [
    ("Timestamp", "<f8"),
    ("BusChannel", "u1"),
    ("ID", "<u4"),
    ("IDE", "u1"),
    ("DLC", "u1"),
    ("DataLength", "u1"),
    ("Dir", "u1"),
]

REMOTE_RECORD = np.dtype(_HEAD_FIELDS)
DATA_RECORD = np.dtype([*_HEAD_FIELDS, ("DataBytes", "V8")])
FD_RECORD = np.dtype(
    [*_HEAD_FIELDS, ("EDL", "u1"), ("BRS", "u1"), ("ESI", "u1"), ("DataBytes", "V64")]
)
ERROR_RECORD = np.dtype([*_HEAD_FIELDS, ("DataBytes", "V8"), ("ErrorType", "u1")])
"""ID and DataBytes are those of SocketCAN's error frames, as python-can writes and reads them here;
IDE is set, so that no tool takes the ID for one of the bus."""

OTHER_ERROR, BIT_ERROR, FORM_ERROR, STUFF_ERROR, ACK_ERROR = 0, 1, 2, 3, 5
"""Values of the field ErrorType; 4 is a wrong CRC."""


class Block(NamedTuple):
    """One block of a file.

    Attributes:
        kind: its identifier, as in ``b"##CN"``.
        links: addresses.
        data: what follows the links.
    """

    kind: bytes
    links: tuple[int, ...]
    data: bytes


def pack_block(kind: bytes, links: Sequence[int], data: bytes = b"") -> bytes:
    """Return a block's bytes, filled up to a multiple of 8."""
    length = HEADER.size + 8 * len(links) + len(data)
    block = b"".join(
        (
            HEADER.pack(kind, 0, length, len(links)),
            struct.pack(f"<{len(links)}Q", *links),
            data,
        )
    )
    return block + bytes(-len(block) % 8)


def pack_text(text: str, kind: bytes = b"##TX") -> bytes:
    """Return a text block, or with another kind an XML block."""
    raw = text.encode(errors="backslashreplace") + b"\0"
    return pack_block(kind, (), raw + bytes(-len(raw) % 8))
