"""Devices with one defect each: the suite names the clause that they break.

Each defect alters the frames of a sound node on their way out or in, as a mistake of a device's
firmware would.
"""

import itertools
import struct

import pytest

from hil_bench.canopen_device import abort_codes
from hil_bench.canopen_device.frame import Frame

SDO_ANSWER, HEARTBEAT, EMCY, TPDO = 0x585, 0x705, 0x085, 0x185


def altered(can_id, change):
    """A defect: data that the node sends by an identifier are changed; None is not sent at all."""

    def says(frame):
        data = change(frame.data) if frame.can_id == can_id else frame.data
        return [] if data is None else [frame._replace(data=data)]

    return says


def aborts_with(code, instead_of):
    """A defect: one abort code in place of another."""
    right, wrong = (struct.pack("<I", number) for number in (instead_of[0], code))

    def change(data):
        is_it = data[:1] == b"\x80" and data[4:] == right
        return data[:4] + wrong if is_it else data

    return altered(SDO_ANSWER, change)


def confirms(command, index):
    """A defect: a download is confirmed that should be aborted."""

    def change(data):
        if data[0] == 0x80 and struct.unpack_from("<H", data, 1)[0] == index:
            return bytes([command]) + data[1:4] + bytes(4)
        return data

    return altered(SDO_ANSWER, change)


def deaf_to(can_id):
    """A defect: frames by an identifier are not heard."""
    return lambda frame: [] if frame.can_id == can_id else [frame]


def flips(byte, bits, where):
    """Bits of one byte are wrong in the frames that a condition names."""
    return lambda data: (
        data[:byte] + bytes([data[byte] ^ bits]) + data[byte + 1 :] if where(data) else data
    )


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


def is_segment(data):
    return data[0] >> 5 == 0


def is_second_block_segment(data):
    return data[0] == 0x82  # and the last one of eleven bytes


def every_second(can_id):
    """A defect: every second of the frames with one identifier is lost."""
    kept = itertools.cycle((False, True))
    return lambda frame: [frame] if frame.can_id != can_id or next(kept) else []


def twice(can_id):
    """A defect: frames by an identifier are sent twice."""
    return lambda frame: [frame] * (1 + (frame.can_id == can_id))


def starts(beginning):
    """A condition: the data begin so."""
    return lambda data: data[: len(beginning)] == beginning


def emergency_after(beginning):
    """A defect: an EMCY follows an SDO answer that begins so."""
    emergency = Frame(EMCY, b"\x30\x81\x11\0\0\0\0\0")

    def says(frame):
        is_it = frame.can_id == SDO_ANSWER and starts(beginning)(frame.data)
        return [frame, emergency] if is_it else [frame]

    return says


def written_otherwise(asked, done):
    """A defect: a download of one value is taken for that of another."""
    asked, done = bytes.fromhex(asked), bytes.fromhex(done)

    def hears(frame):
        if frame.can_id == 0x605 and starts(asked)(frame.data):
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
SAYS = {
    "no heartbeat": (
        altered(HEARTBEAT, lambda d: d if d == b"\0" else None),
        "7.5.2.20",
        "Error control",
    ),
    "EMCY for nothing": (emergency_after(b"\x60\x16\x10\x01"), "7.5.2.19", "Error control"),
    "EMCY 0000h with another register": (
        altered(EMCY, flips(2, 0x10, lambda d: d[:2] == b"\0\0")),
        "7.2.7.1",
        "EMCY",
    ),
    "another code in the history": (
        altered(SDO_ANSWER, flips(4, 1, starts(b"\x43\x03\x10\x01"))),
        "7.5.2.4",
        "EMCY",
    ),
    "five entries of identity": (
        altered(SDO_ANSWER, flips(4, 1, starts(b"\x4f\x18\x10\x00"))),
        "7.5.2.21",
        "Object dictionary",
    ),
    "every answer twice": (twice(SDO_ANSWER), "7.2.4.3.6", "SDO upload"),
    "wrong length of a segmented upload": (
        altered(SDO_ANSWER, flips(4, 1, starts(b"\x41"))),
        "7.2.4.3.7",
        "SDO upload",
    ),
    "another object in a confirmation": (
        altered(SDO_ANSWER, flips(1, 1, starts(b"\x60"))),
        "7.2.4.3.3",
        "SDO download",
    ),
    "wrong toggle in a confirmation": (
        altered(SDO_ANSWER, flips(0, 0x10, starts(b"\x20"))),
        "7.2.4.3.4",
        "SDO download",
    ),
    "block upload without its last segment": (
        altered(SDO_ANSWER, lambda d: None if is_second_block_segment(d) else d),
        "7.2.4.3.13",
        "SDO block transfer",
    ),
    "block upload with a wrong end": (
        altered(SDO_ANSWER, flips(0, 0x20, lambda d: d[0] & 0xE3 == 0xC1)),
        "7.2.4.3.13",
        "SDO block transfer",
    ),
    "block upload with a wrong length": (
        altered(SDO_ANSWER, flips(4, 1, starts(b"\xc6"))),
        "7.2.4.3.13",
        "SDO block transfer",
    ),
    "block upload with a wrong beginning": (
        altered(SDO_ANSWER, flips(0, 0x18, starts(b"\xc6"))),
        "7.2.4.3.14",
        "SDO block transfer",
    ),
    "block download with a wrong beginning": (
        altered(SDO_ANSWER, flips(0, 0x10, starts(b"\xa4"))),
        "7.2.4.3.9",
        "SDO block transfer",
    ),
    "block download with a wrong confirmation": (
        altered(SDO_ANSWER, flips(0, 1, starts(b"\xa2"))),
        "7.2.4.3.9",
        "SDO block transfer",
    ),
    "block download with a wrong end": (
        altered(SDO_ANSWER, flips(0, 2, starts(b"\xa1"))),
        "7.2.4.3.9",
        "SDO block transfer",
    ),
    "produces no SYNC": (altered(0x080, lambda _: None), "7.5.2.6", "SYNC and TIME"),
    "stores in a way that there is not": (
        altered(SDO_ANSWER, flips(5, 1, starts(b"\x43\x10\x10\x01"))),
        "7.5.2.13",
        "Store and restore",
    ),
    "LSS takes a reserved bit timing": (
        altered(0x7E4, lambda d: d[:1] + bytes(7) if d[0] == 0x13 else d),
        "CiA 305, configure bit timing",
        "LSS",
    ),
    "no boot-up": (altered(HEARTBEAT, lambda d: None if d == b"\0" else d), "7.2.8.3.3", "NMT"),
    "boot-up with a wrong byte": (
        altered(HEARTBEAT, lambda d: b"\x7f" if d == b"\0" else d),
        "7.2.8.3.3",
        "NMT",
    ),
    "wrong state": (
        altered(HEARTBEAT, lambda d: b"\x7f" if d == b"\x04" else d),
        "7.2.8.3.1",
        "NMT",
    ),
    "heartbeat of two bytes": (altered(HEARTBEAT, lambda d: d + b"\0"), "7.2.8.3.1", "NMT"),
    "slow heartbeat": (every_second(HEARTBEAT), "7.5.2.20", "Error control"),
    "guarding without toggle": (
        altered(HEARTBEAT, lambda d: bytes([d[0] & 0x7F])),
        "7.2.8.3.2.1",
        "Error control",
    ),
    "wrong device type": (
        altered(SDO_ANSWER, flips(4, 1, lambda d: d[:4] == b"\x43\x00\x10\x00")),
        "7.5.2.1",
        "Object dictionary",
    ),
    "another revision": (
        altered(SDO_ANSWER, flips(4, 1, lambda d: d[:4] == b"\x43\x18\x10\x03")),
        "7.5.2.21",
        "Object dictionary",
    ),
    "four bytes for one": (
        altered(SDO_ANSWER, flips(0, 0x0C, lambda d: d[:4] == b"\x4f\x01\x10\x00")),
        "7.5.2.2",
        "Object dictionary",
    ),
    "wrong length of a float": (
        altered(SDO_ANSWER, flips(0, 0x04, lambda d: d[:4] == b"\x43\x12\x20\x00")),
        "7.4.1",
        "Object dictionary",
    ),
    "wrong highest sub-index": (
        altered(SDO_ANSWER, flips(4, 1, lambda d: d[:4] == b"\x4f\x16\x10\x00")),
        "7.4.1",
        "Object dictionary",
    ),
    "no object as general error": (
        aborts_with(0x08000000, abort_codes.NO_OBJECT),
        "7.2.4.3.17",
        "Object dictionary",
    ),
    "no sub-index as no object": (
        aborts_with(0x06020000, abort_codes.NO_SUBINDEX),
        "7.2.4.3.17",
        "Object dictionary",
    ),
    "write-only as unsupported": (
        aborts_with(0x06010000, abort_codes.WRITE_ONLY),
        "7.2.4.3.17",
        "Object dictionary",
    ),
    "read-only as unsupported": (
        aborts_with(0x06010000, abort_codes.READ_ONLY),
        "7.2.4.3.17",
        "Object dictionary",
    ),
    "read-only confirmed": (confirms(0x60, 0x1000), "7.2.4.3.17", "Object dictionary"),
    "limit as general error": (
        aborts_with(0x08000000, abort_codes.VALUE_TOO_HIGH),
        "7.2.4.3.17",
        "Object dictionary",
    ),
    "limit confirmed": (confirms(0x60, 0x2026), "7.2.4.3.17", "Object dictionary"),
    "another object in the answer": (
        altered(SDO_ANSWER, flips(3, 1, lambda d: d[0] >> 5 == 2)),
        "7.2.4.3.6",
        "SDO upload",
    ),
    "no toggle in upload segments": (
        altered(SDO_ANSWER, lambda d: bytes([d[0] & 0xEF]) + d[1:] if is_segment(d) else d),
        "7.2.4.3.7",
        "SDO upload",
    ),
    "toggle error as specifier error": (
        aborts_with(0x05040001, abort_codes.TOGGLE),
        "7.2.4.3.17",
        "SDO upload",
    ),
    "specifier error as general error": (
        aborts_with(0x08000000, abort_codes.COMMAND_SPECIFIER),
        "7.2.4.3.17",
        "SDO upload",
    ),
    "time-out as general error": (
        aborts_with(0x08000000, abort_codes.TIME_OUT),
        "7.2.4.3.17",
        "SDO upload",
    ),
    "too long as general error": (
        aborts_with(0x08000000, abort_codes.LENGTH_TOO_HIGH),
        "7.2.4.3.17",
        "SDO download",
    ),
    "too short as general error": (
        aborts_with(0x08000000, abort_codes.LENGTH_TOO_LOW),
        "7.2.4.3.17",
        "SDO download",
    ),
    "reserved bytes of a short answer": (
        altered(SDO_ANSWER, lambda d: d[:7]),
        "7.2.4.3.6",
        "SDO upload",
    ),
    "wrong CRC of an upload": (
        altered(SDO_ANSWER, flips(1, 1, lambda d: d[0] & 0xE3 == 0xC1)),
        "7.2.4.3.13",
        "SDO block transfer",
    ),
    "segment out of sequence": (
        altered(SDO_ANSWER, flips(0, 1, is_second_block_segment)),
        "7.2.4.3.13",
        "SDO block transfer",
    ),
    "CRC error as general error": (
        aborts_with(0x08000000, abort_codes.CRC),
        "7.2.4.3.16",
        "SDO block transfer",
    ),
    "block size as general error": (
        aborts_with(0x08000000, abort_codes.BLOCK_SIZE),
        "7.2.4.3.13",
        "SDO block transfer",
    ),
    "sequence as general error": (
        aborts_with(0x08000000, abort_codes.SEQUENCE_NUMBER),
        "7.2.4.3.14",
        "SDO block transfer",
    ),
    "too many segments confirmed": (
        altered(SDO_ANSWER, flips(1, 4, lambda d: d[0] == 0xA2 and d[1] == 2)),
        "7.2.4.3.10",
        "SDO block transfer",
    ),
    "no EMCY": (altered(EMCY, lambda _: None), "7.5.2.19", "Error control"),
    "EMCY of six bytes": (altered(EMCY, lambda d: d[:6]), "7.2.7.3.1", "EMCY"),
    "EMCY without register": (altered(EMCY, lambda d: d[:2] + b"\0" + d[3:]), "7.2.7.3.1", "EMCY"),
    "no EMCY 0000h": (altered(EMCY, lambda d: None if d[:2] == b"\0\0" else d), "7.2.7.1", "EMCY"),
    "history beyond its end": (
        aborts_with(0x08000000, abort_codes.NO_DATA),
        "7.5.2.4",
        "Object dictionary",
    ),
    "PDO twice": (twice(TPDO), "7.5.2.37", "TPDO"),
    "PDO too short": (altered(TPDO, lambda d: d[:-1]), "7.5.2.37", "TPDO"),
    "PDO with wrong values": (altered(TPDO, flips(0, 1, lambda _: True)), "7.5.2.38", "TPDO"),
    "PDO lost at times": (every_second(TPDO), "7.5.2.37", "TPDO"),
    "mapping what is not there": (
        aborts_with(0x06040041, abort_codes.NO_OBJECT),
        "7.2.4.3.17",
        "PDO mapping",
    ),
    "not mappable as no object": (
        aborts_with(0x06020000, abort_codes.NOT_MAPPABLE),
        "7.2.4.3.17",
        "PDO mapping",
    ),
    "identifier of a valid PDO taken": (
        confirms(0x60, 0x1400),
        "7.5.2.35",
        "PDO parameters",
    ),
    "SYNC without counter": (altered(0x080, lambda _: b""), "7.2.5.3.1", "SYNC and TIME"),
    "slow SYNC": (every_second(0x080), "7.5.2.6", "SYNC and TIME"),
    "counter changed while running": (
        aborts_with(0x08000020, abort_codes.DEVICE_STATE),
        "7.5.2.22",
        "SYNC and TIME",
    ),
    "wrong signature as general error": (
        aborts_with(0x08000000, abort_codes.NOT_STORED),
        "7.5.2.13",
        "Store and restore",
    ),
    "wrong LSS node-ID": (
        altered(0x7E4, flips(1, 2, lambda d: d[0] == 0x5E)),
        "CiA 305, inquire identity",
        "LSS",
    ),
    "LSS takes any node-ID": (
        altered(0x7E4, lambda d: d[:1] + bytes(7) if d[0] == 0x11 else d),
        "CiA 305, configure node-ID",
        "LSS",
    ),
}

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
    "does not identify itself": (
        lambda f: [] if f.can_id == 0x7E5 and f.data[0] == 0x46 else [f],
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


@pytest.mark.parametrize("name", SAYS)
def test_what_it_says_wrongly_is_named(laboratory, name):
    laboratory.says, clause, chapter = SAYS[name]
    assert clause in laboratory.failed_clauses(chapter)


@pytest.mark.parametrize("name", HEARS)
def test_what_it_hears_wrongly_is_named(laboratory, name):
    laboratory.hears, clause, chapter = HEARS[name]
    assert clause in laboratory.failed_clauses(chapter)
