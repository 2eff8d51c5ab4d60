"""Devices that send something wrong, one defect each: the suite names the clause that they break.

Each defect alters the frames of a sound node on their way out, as a mistake of a device's firmware
would.
"""

import itertools
import struct

import pytest

from hil_bench.canopen_device.frame import Frame

SDO_ANSWER, HEARTBEAT, EMCY, TPDO = 0x585, 0x705, 0x085, 0x185


def altered(can_id, change):
    """A defect: data that the node sends by an identifier are changed; None is not sent at all."""

    def says(frame):
        data = change(frame.data) if frame.can_id == can_id else frame.data
        return [] if data is None else [frame._replace(data=data)]

    return says


def confirms(command, index):
    """A defect: a download is confirmed that should be aborted."""

    def change(data):
        if data[0] == 0x80 and struct.unpack_from("<H", data, 1)[0] == index:
            return bytes([command]) + data[1:4] + bytes(4)
        return data

    return altered(SDO_ANSWER, change)


def flips(byte, bits, where):
    """Bits of one byte are wrong in the frames that a condition names."""
    return lambda data: (
        data[:byte] + bytes([data[byte] ^ bits]) + data[byte + 1 :] if where(data) else data
    )


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
    "another product": (
        altered(SDO_ANSWER, flips(4, 1, starts(b"\x43\x18\x10\x02"))),
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
    "read-only confirmed": (confirms(0x60, 0x1000), "7.2.4.3.17", "Object dictionary"),
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
    "too many segments confirmed": (
        altered(SDO_ANSWER, flips(1, 4, lambda d: d[0] == 0xA2 and d[1] == 2)),
        "7.2.4.3.10",
        "SDO block transfer",
    ),
    "no EMCY": (altered(EMCY, lambda _: None), "7.5.2.19", "Error control"),
    "EMCY of six bytes": (altered(EMCY, lambda d: d[:6]), "7.2.7.3.1", "EMCY"),
    "EMCY without register": (altered(EMCY, lambda d: d[:2] + b"\0" + d[3:]), "7.2.7.3.1", "EMCY"),
    "no EMCY 0000h": (altered(EMCY, lambda d: None if d[:2] == b"\0\0" else d), "7.2.7.1", "EMCY"),
    "PDO twice": (twice(TPDO), "7.5.2.37", "TPDO"),
    "PDO too short": (altered(TPDO, lambda d: d[:-1]), "7.5.2.37", "TPDO"),
    "PDO with wrong values": (altered(TPDO, flips(0, 1, lambda _: True)), "7.5.2.38", "TPDO"),
    "PDO lost at times": (every_second(TPDO), "7.5.2.37", "TPDO"),
    "identifier of a valid PDO taken": (
        confirms(0x60, 0x1400),
        "7.5.2.35",
        "PDO parameters",
    ),
    "SYNC without counter": (altered(0x080, lambda _: b""), "7.2.5.3.1", "SYNC and TIME"),
    "slow SYNC": (every_second(0x080), "7.5.2.6", "SYNC and TIME"),
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


@pytest.mark.parametrize("name", SAYS)
def test_what_it_says_wrongly_is_named(laboratory, name):
    laboratory.says, clause, chapter = SAYS[name]
    assert clause in laboratory.failed_clauses(chapter)
