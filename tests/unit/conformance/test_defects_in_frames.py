"""Devices that send, hear or abort wrongly, one defect each: the suite names the clause they break.

Each defect alters the frames of a sound node on their way out or in, as a mistake of a device's
firmware would.
"""

import itertools
import struct

import pytest
from support.changed_frames import (
    ANSWER,
    EMCY,
    HEARTBEAT,
    LSS,
    REQUEST,
    aborted_otherwise,
    altered,
    begun_otherwise,
    lost,
)

from hil_bench.canopen_device import abort_codes as right
from hil_bench.canopen_device.frame import Frame

SYNC, TPDO, RPDO, LSS_ANSWER = 0x080, 0x185, 0x205, 0x7E4


def confirms(index):
    """A defect: a download is confirmed that should be aborted."""

    def change(data):
        if data[0] == 0x80 and struct.unpack_from("<H", data, 1)[0] == index:
            return b"\x60" + data[1:4] + bytes(4)
        return data

    return altered(ANSWER, change)


def flips(byte, bits, where=lambda _data: True):
    """Bits of one byte are wrong in the data that a condition names."""
    return lambda data: (
        data[:byte] + bytes([data[byte] ^ bits]) + data[byte + 1 :] if where(data) else data
    )


def answers(beginning, byte, bits):
    """A defect: bits of one byte are wrong in SDO answers that begin so."""
    begins = bytes.fromhex(beginning)
    return altered(ANSWER, flips(byte, bits, lambda data: data.startswith(begins)))


def is_segment(data):
    return data[0] >> 5 == 0


def is_end_of_block_upload(data):
    return data[0] & 0xE3 == 0xC1


SECOND_BLOCK_SEGMENT = "82"  # the last one of eleven bytes


def every_second(can_id):
    """A defect: every second of the frames with one identifier is lost."""
    kept = itertools.cycle((False, True))
    return lambda frame: [frame] if frame.can_id != can_id or next(kept) else []


def twice(can_id):
    """A defect: frames by an identifier are sent twice."""
    return lambda frame: [frame] * (1 + (frame.can_id == can_id))


def emergency_after(beginning):
    """A defect: an EMCY follows an SDO answer that begins so."""
    emergency = Frame(EMCY, b"\x30\x81\x11\0\0\0\0\0")

    def says(frame):
        is_it = frame.can_id == ANSWER and frame.data.startswith(bytes.fromhex(beginning))
        return [frame, emergency] if is_it else [frame]

    return says


# What is wrong: the clause that it breaks, and the defect; by the chapter that finds it.
SAYS = {
    "NMT": {
        "no boot-up": ("7.2.8.3.3", lost(HEARTBEAT, "00")),
        "boot-up with a wrong byte": ("7.2.8.3.3", begun_otherwise(HEARTBEAT, "00", "7f")),
        "wrong state": ("7.2.8.3.1", begun_otherwise(HEARTBEAT, "04", "7f")),
        "heartbeat of two bytes": ("7.2.8.3.1", altered(HEARTBEAT, lambda d: d + b"\0")),
    },
    "Error control": {
        "no heartbeat": ("7.5.2.20", altered(HEARTBEAT, lambda d: d if d == b"\0" else None)),
        "slow heartbeat": ("7.5.2.20", every_second(HEARTBEAT)),
        "guarding without toggle": (
            "7.2.8.3.2.1",
            altered(HEARTBEAT, lambda d: bytes([d[0] & 0x7F])),
        ),
        "EMCY for nothing": ("7.5.2.19", emergency_after("60161001")),
        "no EMCY": ("7.5.2.19", lost(EMCY)),
    },
    "EMCY": {
        "another code in the history": ("7.5.2.4", answers("43031001", 4, 1)),
        "EMCY of six bytes": ("7.2.7.3.1", altered(EMCY, lambda d: d[:6])),
        "EMCY without register": ("7.2.7.3.1", altered(EMCY, lambda d: d[:2] + b"\0" + d[3:])),
        "no EMCY 0000h": ("7.2.7.1", lost(EMCY, "0000")),
        "EMCY 0000h with another register": (
            "7.2.7.1",
            altered(EMCY, flips(2, 0x10, lambda d: d[:2] == b"\0\0")),
        ),
    },
    "Object dictionary": {
        "wrong device type": ("7.5.2.1", answers("43001000", 4, 1)),
        "five entries of identity": ("7.5.2.21", answers("4f181000", 4, 1)),
        "another product": ("7.5.2.21", answers("43181002", 4, 1)),
        "another revision": ("7.5.2.21", answers("43181003", 4, 1)),
        "four bytes for one": ("7.5.2.2", answers("4f011000", 0, 0x0C)),
        "wrong length of a float": ("7.4.1", answers("43122000", 0, 0x04)),
        "wrong highest sub-index": ("7.4.1", answers("4f161000", 4, 1)),
        "read-only confirmed": ("7.2.4.3.17", confirms(0x1000)),
        "limit confirmed": ("7.2.4.3.17", confirms(0x2026)),
    },
    "SDO upload": {
        "every answer twice": ("7.2.4.3.6", twice(ANSWER)),
        "another object in the answer": (
            "7.2.4.3.6",
            altered(ANSWER, flips(3, 1, lambda d: d[0] >> 5 == 2)),
        ),
        "reserved bytes of a short answer": ("7.2.4.3.6", altered(ANSWER, lambda d: d[:7])),
        "wrong length of a segmented upload": ("7.2.4.3.7", answers("41", 4, 1)),
        "no toggle in upload segments": (
            "7.2.4.3.7",
            altered(ANSWER, lambda d: bytes([d[0] & 0xEF]) + d[1:] if is_segment(d) else d),
        ),
    },
    "SDO download": {
        "another object in a confirmation": ("7.2.4.3.3", answers("60", 1, 1)),
        "wrong toggle in a confirmation": ("7.2.4.3.4", answers("20", 0, 0x10)),
    },
    "SDO block transfer": {
        "upload without its last segment": ("7.2.4.3.13", lost(ANSWER, SECOND_BLOCK_SEGMENT)),
        "upload segment out of sequence": ("7.2.4.3.13", answers(SECOND_BLOCK_SEGMENT, 0, 1)),
        "upload with a wrong end": (
            "7.2.4.3.13",
            altered(ANSWER, flips(0, 0x20, is_end_of_block_upload)),
        ),
        "upload with a wrong CRC": (
            "7.2.4.3.13",
            altered(ANSWER, flips(1, 1, is_end_of_block_upload)),
        ),
        "upload with a wrong length": ("7.2.4.3.13", answers("c6", 4, 1)),
        "upload with a wrong beginning": ("7.2.4.3.14", answers("c6", 0, 0x18)),
        "download with a wrong beginning": ("7.2.4.3.9", answers("a4", 0, 0x10)),
        "download with a wrong confirmation": ("7.2.4.3.9", answers("a2", 0, 1)),
        "download with a wrong end": ("7.2.4.3.9", answers("a1", 0, 2)),
        "too many segments confirmed": ("7.2.4.3.10", answers("a202", 1, 4)),
    },
    "TPDO": {
        "PDO twice": ("7.5.2.37", twice(TPDO)),
        "PDO too short": ("7.5.2.37", altered(TPDO, lambda d: d[:-1])),
        "PDO lost at times": ("7.5.2.37", every_second(TPDO)),
        "PDO with wrong values": ("7.5.2.38", altered(TPDO, flips(0, 1))),
    },
    "PDO parameters": {"identifier of a valid PDO taken": ("7.5.2.35", confirms(0x1400))},
    "SYNC and TIME": {
        "produces no SYNC": ("7.5.2.6", lost(SYNC)),
        "slow SYNC": ("7.5.2.6", every_second(SYNC)),
        "SYNC without counter": ("7.2.5.3.1", altered(SYNC, lambda _: b"")),
    },
    "Store and restore": {
        "stores in a way that there is not": ("7.5.2.13", answers("43101001", 5, 1))
    },
    "LSS": {
        "wrong LSS node-ID": (
            "CiA 305, inquire identity",
            altered(LSS_ANSWER, flips(1, 2, lambda d: d[0] == 0x5E)),
        ),
        "LSS takes any node-ID": (
            "CiA 305, configure node-ID",
            begun_otherwise(LSS_ANSWER, "11", "11 00000000000000"),
        ),
        "LSS takes a reserved bit timing": (
            "CiA 305, configure bit timing",
            begun_otherwise(LSS_ANSWER, "13", "13 00000000000000"),
        ),
    },
}


def each(table):
    """Return the chapter, the clause and the defect of each entry."""
    return [
        pytest.param(chapter, *entry, id=name)
        for chapter, entries in table.items()
        for name, entry in entries.items()
    ]


@pytest.mark.parametrize(("chapter", "clause", "defect"), each(SAYS))
def test_what_it_says_wrongly_is_named(laboratory, chapter, clause, defect):
    laboratory.says = defect
    assert clause in laboratory.failed_clauses(chapter)


def hears_any_node(frame):
    """NMT commands to other nodes are taken as one's own."""
    if frame.can_id == 0 and len(frame.data) == 2 and not frame.is_extended:
        return [frame._replace(data=bytes([frame.data[0], 5]))]
    return [frame]


def hears_extended(frame):
    """A 29-bit identifier counts like an 11-bit one."""
    return [frame._replace(is_extended=False)]


def pads_short_requests(frame):
    """SDO requests of fewer than eight bytes are filled up."""
    if frame.can_id == REQUEST:
        return [frame._replace(data=frame.data.ljust(8, b"\0"), is_remote=False)]
    return [frame]


def writes(asked, done):
    """A defect: a download of one value is taken for that of another."""
    return begun_otherwise(REQUEST, asked, done)


def with_own_serial_number(*specifiers):
    """A defect: whatever serial number LSS names, it is one's own (0x1018.04 of device.eds)."""
    own = b"\x78\x56\x34\x12\0\0\0"
    return altered(LSS, lambda d: d[:1] + own if d[0] in specifiers else d)


HEARS = {
    "NMT": {
        "obeys commands to others": ("7.2.8.3.1", hears_any_node),
        "obeys short commands": (
            "7.2.8.3.1",
            altered(0, lambda d: d + b"\x05" if len(d) == 1 else d),
        ),
        "ignores commands to all": (
            "7.2.8.3.1",
            altered(0, lambda d: None if d[1:] == b"\0" else d),
        ),
        "does not restore by a reset": ("7.2.8.3.3", begun_otherwise(0, "8205", "8005")),
    },
    "Error control": {
        "heartbeat cannot be switched off": ("7.5.2.20", writes("2b171000 0000", "2b171000 0a00")),
        "does not know 1029h": ("7.5.2.32", writes("2f291001 02", "2f291001 00")),
        "does not guard": ("7.2.8.3.2.1", lost(HEARTBEAT)),
        "does not watch heartbeats": ("7.5.2.19", lost(0x77F)),
    },
    "EMCY": {
        "cannot be switched off": ("7.5.2.17", writes("23141000 85000080", "23141000 85000000")),
        "knows no inhibit time": ("7.5.2.18", writes("2b151000 d007", "2b151000 0000")),
    },
    "SDO upload": {
        "takes 29-bit frames for its own": ("7.2.4.3.1", hears_extended),
        "answers short requests": ("7.2.4.3.1", pads_short_requests),
        "deaf to aborts": ("7.2.4.3.17", lost(REQUEST, "80")),
        "serves any node-ID": (
            "7.2.4.2",
            lambda f: [f._replace(can_id=REQUEST)] if f.can_id == 0x67F else [f],
        ),
    },
    "SDO download": {
        "stores other bytes": (
            "7.2.4.3.4",
            altered(REQUEST, lambda d: b"\0!" + d[2:] if len(d) == 8 and d[0] == 0 else d),
        ),
    },
    "PDO mapping": {
        "puts a dummy entry into an object": (
            "7.5.2.36",
            altered(RPDO, lambda d: d[1:] + b"\0" if d[:1] == b"\xff" else d),
        ),
    },
    "TPDO": {
        "deaf to SYNC": ("7.5.2.37", lost(SYNC)),
        "takes a reserved type": ("7.5.2.37", writes("2f001802 f1", "2f001802 01")),
        "answers remote frames by type 252 alone": (
            "7.2.2.5",
            writes("2f001802 fd", "2f001802 f0"),
        ),
        "does not leave OPERATIONAL": ("7.3.2.3", begun_otherwise(0, "8005", "0105")),
    },
    "RPDO": {
        "deaf to RPDO": ("7.5.2.35", lost(RPDO)),
        "misses RPDOs too early": ("7.5.2.35", writes("2b001405 f401", "2b001405 0a00")),
        "takes short RPDOs": ("7.2.7.1", altered(RPDO, lambda d: d.ljust(4, b"\0"))),
    },
    "SYNC and TIME": {
        "keeps to the old SYNC": ("7.5.2.5", lost(0x6D2)),
        "takes a counter of 1": ("7.5.2.22", writes("2f191000 01", "2f191000 02")),
    },
    "Store and restore": {
        "stores another value": ("7.5.2.13", writes("2b171000 e110", "2b171000 0000")),
        "restores at once": ("7.5.2.14", writes("2b171000 e110", "2b171000 0000")),
        "forgets what it stores": (
            "7.5.2.13",
            writes("23101001 73617665", "40101001 00000000"),  # "save"
        ),
    },
    "LSS": {
        "answers to any address": (
            "CiA 305, switch state selective",
            with_own_serial_number(0x43),
        ),
        "is any address": (
            "CiA 305, identify remote slave",
            with_own_serial_number(0x4A, 0x4B),
        ),
    },
}


@pytest.mark.parametrize(("chapter", "clause", "defect"), each(HEARS))
def test_what_it_hears_wrongly_is_named(laboratory, chapter, clause, defect):
    laboratory.hears = defect
    assert clause in laboratory.failed_clauses(chapter)


GENERAL, UNSUPPORTED, NO_OBJECT = 0x08000000, 0x06010000, 0x06020000
SPECIFIER, NOT_STORED = 0x05040001, 0x08000020


@pytest.mark.parametrize(
    ("chapter", "clause", "wrong", "instead_of"),
    [
        ("Object dictionary", "7.2.4.3.17", GENERAL, right.NO_OBJECT),
        ("Object dictionary", "7.2.4.3.17", NO_OBJECT, right.NO_SUBINDEX),
        ("Object dictionary", "7.2.4.3.17", UNSUPPORTED, right.WRITE_ONLY),
        ("Object dictionary", "7.2.4.3.17", UNSUPPORTED, right.READ_ONLY),
        ("Object dictionary", "7.2.4.3.17", GENERAL, right.VALUE_TOO_HIGH),
        ("Object dictionary", "7.5.2.4", GENERAL, right.NO_DATA),  # beyond the history's end
        ("SDO upload", "7.2.4.3.17", SPECIFIER, right.TOGGLE),
        ("SDO upload", "7.2.4.3.17", GENERAL, right.COMMAND_SPECIFIER),
        ("SDO upload", "7.2.4.3.17", GENERAL, right.TIME_OUT),
        ("SDO download", "7.2.4.3.17", GENERAL, right.LENGTH_TOO_HIGH),
        ("SDO download", "7.2.4.3.17", GENERAL, right.LENGTH_TOO_LOW),
        ("SDO block transfer", "7.2.4.3.16", GENERAL, right.CRC),
        ("SDO block transfer", "7.2.4.3.13", GENERAL, right.BLOCK_SIZE),
        ("SDO block transfer", "7.2.4.3.14", GENERAL, right.SEQUENCE_NUMBER),
        ("PDO mapping", "7.5.2.36", GENERAL, right.NO_OBJECT),
        ("PDO mapping", "7.2.4.3.17", NO_OBJECT, right.NOT_MAPPABLE),
        ("SYNC and TIME", "7.5.2.22", NOT_STORED, right.DEVICE_STATE),
        ("Store and restore", "7.5.2.13", GENERAL, right.NOT_STORED),
    ],
)
def test_a_wrong_abort_code_is_named(laboratory, chapter, clause, wrong, instead_of):
    laboratory.says = aborted_otherwise(wrong, instead_of[0])
    assert clause in laboratory.failed_clauses(chapter)
