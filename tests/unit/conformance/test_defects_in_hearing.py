"""Devices that hear something wrongly, one defect each: the suite names the clause they break.

Each defect alters the frames to a sound node, as a mistake of a device's firmware would.
"""

import pytest


def deaf_to(can_id):
    """A defect: frames by an identifier are not heard."""
    return lambda frame: [] if frame.can_id == can_id else [frame]


def hears_any_node(frame):
    """NMT commands to other nodes are taken as one's own."""
    if frame.can_id == 0 and len(frame.data) == 2 and not frame.is_extended:
        return [frame._replace(data=bytes([frame.data[0], 5]))]
    return [frame]


def hears_short_nmt(frame):
    """An NMT command of one byte is taken as one to oneself."""
    if frame.can_id == 0 and len(frame.data) == 1:
        return [frame._replace(data=frame.data + b"\x05")]
    return [frame]


def hears_extended(frame):
    """A 29-bit identifier counts like an 11-bit one."""
    return [frame._replace(is_extended=False)]


def pads_short_requests(frame):
    """SDO requests of fewer than eight bytes are filled up."""
    if frame.can_id == 0x605:
        return [frame._replace(data=frame.data.ljust(8, b"\0"), is_remote=False)]
    return [frame]


def pads_rpdos(frame):
    """RPDOs that are too short are filled up."""
    return [frame._replace(data=frame.data.ljust(4, b"\0"))] if frame.can_id == 0x205 else [frame]


def written_otherwise(asked, done):
    """A defect: a download of one value is taken for that of another."""
    asked, done = bytes.fromhex(asked), bytes.fromhex(done)

    def hears(frame):
        if frame.can_id == 0x605 and frame.data.startswith(asked):
            return [frame._replace(data=done + frame.data[len(done) :])]
        return [frame]

    return hears


def with_own_serial_number(specifiers):
    """A defect: whatever serial number LSS names, it is one's own (0x1018.04 of device.eds)."""

    def hears(frame):
        if frame.can_id == 0x7E5 and frame.data[0] in specifiers:
            return [frame._replace(data=frame.data[:1] + b"\x78\x56\x34\x12\0\0\0")]
        return [frame]

    return hears


def is_first_segment(frame):
    return frame.can_id == 0x605 and len(frame.data) == 8 and frame.data[0] == 0


# Name of the defect: the defect, the clause that it breaks, the chapter that finds it.
HEARS = {
    "heartbeat cannot be switched off": (
        written_otherwise("2b171000 0000", "2b171000 0a00"),
        "7.5.2.20",
        "Error control",
    ),
    "does not know 1029h": (
        written_otherwise("2f291001 02", "2f291001 00"),
        "7.5.2.32",
        "Error control",
    ),
    "EMCY cannot be switched off": (
        written_otherwise("23141000 85000080", "23141000 85000000"),
        "7.5.2.17",
        "EMCY",
    ),
    "knows no inhibit time of EMCY": (
        written_otherwise("2b151000 d007", "2b151000 0000"),
        "7.5.2.18",
        "EMCY",
    ),
    "stores other bytes": (
        lambda f: [f._replace(data=b"\0!" + f.data[2:])] if is_first_segment(f) else [f],
        "7.2.4.3.4",
        "SDO download",
    ),
    "stores another value": (
        written_otherwise("2b171000 e110", "2b171000 0000"),
        "7.5.2.13",
        "Store and restore",
    ),
    "restores at once": (
        written_otherwise("2b171000 e110", "2b171000 0000"),
        "7.5.2.14",
        "Store and restore",
    ),
    "keeps to the old SYNC": (deaf_to(0x6D2), "7.5.2.5", "SYNC and TIME"),
    "takes a counter of 1": (
        written_otherwise("2f191000 01", "2f191000 02"),
        "7.5.2.22",
        "SYNC and TIME",
    ),
    "does not leave OPERATIONAL": (
        lambda f: [f._replace(data=b"\x01\x05")] if f.data == b"\x80\x05" else [f],
        "7.3.2.3",
        "TPDO",
    ),
    "takes a reserved type": (written_otherwise("2f001802 f1", "2f001802 01"), "7.5.2.37", "TPDO"),
    "answers remote frames by type 252 alone": (
        written_otherwise("2f001802 fd", "2f001802 f0"),
        "7.2.2.5",
        "TPDO",
    ),
    "misses RPDOs too early": (
        written_otherwise("2b001405 f401", "2b001405 0a00"),
        "7.5.2.35",
        "RPDO",
    ),
    "answers to any LSS address": (
        with_own_serial_number({0x43}),
        "CiA 305, switch state selective",
        "LSS",
    ),
    "is any LSS address": (
        with_own_serial_number({0x4A, 0x4B}),
        "CiA 305, identify remote slave",
        "LSS",
    ),
    "deaf to SYNC": (deaf_to(0x080), "7.5.2.37", "TPDO"),
    "deaf to RPDO": (deaf_to(0x205), "7.5.2.35", "RPDO"),
    "obeys commands to others": (hears_any_node, "7.2.8.3.1", "NMT"),
    "obeys short commands": (hears_short_nmt, "7.2.8.3.1", "NMT"),
    "ignores commands to all": (
        lambda f: [] if f.can_id == 0 and f.data[1:] == b"\0" else [f],
        "7.2.8.3.1",
        "NMT",
    ),
    "takes 29-bit frames for its own": (hears_extended, "7.2.4.3.1", "SDO upload"),
    "answers short requests": (pads_short_requests, "7.2.4.3.1", "SDO upload"),
    "takes short RPDOs": (pads_rpdos, "7.2.7.1", "RPDO"),
    "does not guard": (deaf_to(0x705), "7.2.8.3.2.1", "Error control"),
    "does not watch heartbeats": (deaf_to(0x77F), "7.5.2.19", "Error control"),
    "deaf to aborts": (
        lambda f: [] if f.can_id == 0x605 and f.data[:1] == b"\x80" else [f],
        "7.2.4.3.17",
        "SDO upload",
    ),
    "serves any node-ID": (
        lambda f: [f._replace(can_id=0x605)] if f.can_id == 0x67F else [f],
        "7.2.4.2",
        "SDO upload",
    ),
    "does not restore by a reset": (
        lambda f: [f._replace(data=b"\x80\x05")] if f.data == b"\x82\x05" else [f],
        "7.2.8.3.3",
        "NMT",
    ),
    "puts a dummy entry into an object": (
        lambda f: [f._replace(data=f.data[1:] + b"\0")] if f.data[:1] == b"\xff" else [f],
        "7.5.2.36",
        "PDO mapping",
    ),
    "forgets what it stores": (
        lambda f: (
            [f._replace(data=b"\x40\x10\x10\x01" + bytes(4))]
            if f.data[:4] == b"\x23\x10\x10\x01" and f.data[4:] == b"save"
            else [f]
        ),
        "7.5.2.13",
        "Store and restore",
    ),
}


@pytest.mark.parametrize("name", HEARS)
def test_what_it_hears_wrongly_is_named(laboratory, name):
    laboratory.hears, clause, chapter = HEARS[name]
    assert clause in laboratory.failed_clauses(chapter)
