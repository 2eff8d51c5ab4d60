"""Devices that send, hear or abort wrongly, one defect each: its checks fail, and no others.

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


SECOND_SEGMENT = "82"  # the last one of eleven bytes


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


UPLOADS = "upload block_size_change lost_segments"
SEGMENTS = "segmented toggle client_abort time_out"

# What is wrong: the checks that need what it breaks, and the defect; by their chapter.
SAYS = {
    "NMT": {
        "no boot-up": ("reset_node reset_communication", lost(HEARTBEAT, "00")),
        "two boot-ups": (
            "reset_node reset_communication",
            lambda f: [f] * (1 + (f.can_id == HEARTBEAT and f.data == b"\0")),
        ),
        "wrong boot-up": ("reset_node reset_communication", begun_otherwise(HEARTBEAT, "00", "7f")),
        "wrong state": ("commands broadcast", begun_otherwise(HEARTBEAT, "04", "7f")),
        "heartbeat of two bytes": (
            (
                "reset_node reset_communication stays_operational after_boot_up commands "
                "broadcast other_node malformed"
            ),
            altered(HEARTBEAT, lambda d: d + b"\0"),
        ),
    },
    "Error control": {
        "no heartbeat": (
            "heartbeat_period guarding error_behaviour",
            altered(HEARTBEAT, lambda d: d if d == b"\0" else None),
        ),
        "slow heartbeat": ("heartbeat_period guarding", every_second(HEARTBEAT)),
        "guarding without toggle": ("guarding", altered(HEARTBEAT, lambda d: bytes([d[0] & 0x7F]))),
        "EMCY for nothing": ("heartbeat_consumer consumer_waits", emergency_after("60161001")),
        "no EMCY": ("life_guarding heartbeat_consumer", lost(EMCY)),
    },
    "EMCY": {
        "another code in the history": ("history", answers("43031001", 4, 1)),
        "no EMCY at all": ("message error_reset history inhibit_time", lost(EMCY)),
        "EMCY of six bytes": ("message", altered(EMCY, lambda d: d[:6])),
        "EMCY without register": ("message", altered(EMCY, lambda d: d[:2] + b"\0" + d[3:])),
        "no EMCY 0000h": ("error_reset", lost(EMCY, "0000")),
        "EMCY 0000h with another register": (
            "error_reset",
            altered(EMCY, flips(2, 0x10, lambda d: d[:2] == b"\0\0")),
        ),
    },
    "Object dictionary": {
        "wrong device type": ("device_type", answers("43001000", 4, 1)),
        "five of identity": ("identity constants highest_subindex", answers("4f181000", 4, 1)),
        "another product": ("identity constants", answers("43181002", 4, 1)),
        "another revision": ("identity constants", answers("43181003", 4, 1)),
        "another object in an abort": (
            "write_only no_object no_subindex history_beyond read_only write_nothing",
            answers("80", 1, 1),
        ),
        "four bytes for one": ("error_register everything_readable", answers("4f011000", 0, 0x0C)),
        "wrong length of a float": ("everything_readable", answers("43122000", 0, 0x04)),
        "wrong highest sub-index": ("constants highest_subindex", answers("4f161000", 4, 1)),
        "read-only confirmed": ("no_subindex read_only", confirms(0x1000)),
        "limit confirmed": ("limits", confirms(0x2026)),
    },
    "SDO upload": {
        "answers twice": ("expedited segmented toggle client_abort time_out burst", twice(ANSWER)),
        "another object in the answer": (
            "expedited segmented toggle client_abort time_out bystander burst",
            altered(ANSWER, flips(3, 1, lambda d: d[0] >> 5 == 2)),
        ),
        "reserved bytes of a short answer": (
            (
                "expedited segmented toggle segment_without_transfer unknown_specifier "
                "fresh_server client_abort time_out bystander burst"
            ),
            altered(ANSWER, lambda d: d[:7]),
        ),
        "wrong length of segments": (SEGMENTS, answers("41", 4, 1)),
        "another object in an abort": ("toggle time_out", answers("80", 1, 1)),
        "no toggle in upload segments": (
            SEGMENTS,
            altered(ANSWER, lambda d: bytes([d[0] & 0xEF]) + d[1:] if is_segment(d) else d),
        ),
    },
    "SDO download": {
        "another object in a confirmation": (
            (
                "download_expedited without_size wrong_length segmented_short "
                "segmented_without_size segmented_long download_toggle more_than_announced "
                "fewer_than_announced announced_wrong download_client_abort further_channel"
            ),
            answers("60", 1, 1),
        ),
        "a reserved bit in a confirmation": (
            (
                "download_expedited without_size download_toggle more_than_announced "
                "fewer_than_announced download_client_abort"
            ),
            answers("601710", 0, 1),
        ),
        "wrong toggle": (
            "segmented_short segmented_without_size segmented_long",
            answers("20", 0, 0x10),
        ),
    },
    "SDO block transfer": {
        "upload without its last": ("upload lost_segments", lost(ANSWER, SECOND_SEGMENT)),
        "upload out of sequence": ("upload lost_segments", answers(SECOND_SEGMENT, 0, 1)),
        "upload with a wrong end": (
            UPLOADS,
            altered(ANSWER, flips(0, 0x20, is_end_of_block_upload)),
        ),
        "upload with a wrong CRC": (UPLOADS, altered(ANSWER, flips(1, 1, is_end_of_block_upload))),
        "upload of a wrong length": (UPLOADS, answers("c6", 4, 1)),
        "upload with a wrong beginning": (
            "upload block_size_change lost_segments sequence_beyond",
            answers("c6", 0, 0x18),
        ),
        "download with a wrong beginning": (
            ("download download_lost wrong_crc shorter_than_announced segment_zero download_abort"),
            answers("a4", 0, 0x10),
        ),
        "download with a wrong confirmation": (
            "download download_lost wrong_crc shorter_than_announced download_abort",
            answers("a2", 0, 1),
        ),
        "download with a wrong end": ("download download_lost", answers("a1", 0, 2)),
        "too many segments confirmed": ("download_lost", answers("a202", 1, 4)),
    },
    "PDO mapping": {"another mapping than was written": ("procedure", answers("43001601", 6, 1))},
    "TPDO": {
        "no PDO": (
            "each_sync third_sync contents event_timer inhibit_time remote_request start_value",
            lost(TPDO),
        ),
        "PDO twice": ("each_sync third_sync event_timer inhibit_time start_value", twice(TPDO)),
        "PDO too short": (
            "each_sync third_sync contents remote_request start_value",
            altered(TPDO, lambda d: d[:-1]),
        ),
        "PDO lost at times": (
            "each_sync third_sync contents event_timer remote_request start_value",
            every_second(TPDO),
        ),
        "PDO with wrong values": ("contents", altered(TPDO, flips(0, 1))),
        "second PDO too short": (
            "each_sync third_sync contents remote_request start_value",
            altered(0x285, lambda d: d[:-1]),
        ),
        "second PDO with wrong values": ("contents", altered(0x285, flips(0, 1))),
    },
    "PDO parameters": {
        "identifier of a valid PDO taken": ("identifier_of_valid restricted", confirms(0x1400))
    },
    "SYNC and TIME": {
        "produces no SYNC": ("producer produced_counter", lost(SYNC)),
        "slow SYNC": ("producer produced_counter", every_second(SYNC)),
        "SYNC without counter": ("produced_counter", altered(SYNC, lambda _: b"")),
    },
    "Store and restore": {
        "stores in a way that there is not": ("store_ability", answers("43101001", 5, 1)),
        "another value than was stored": ("store restore", answers("4b1710", 4, 1)),
    },
    "LSS": {
        "another answer to a selection": (
            "select inquire node_id bit_timing",
            begun_otherwise(LSS_ANSWER, "44", "45"),
        ),
        "another answer to an inquiry": ("inquire", begun_otherwise(LSS_ANSWER, "5b", "5a")),
        "another answer to a bit timing": ("bit_timing", begun_otherwise(LSS_ANSWER, "13", "12")),
        "another identification": ("identify", begun_otherwise(LSS_ANSWER, "4f", "4e")),
        "wrong LSS node-ID": ("inquire", altered(LSS_ANSWER, flips(1, 2, lambda d: d[0] == 0x5E))),
        "takes any node-ID": ("node_id", begun_otherwise(LSS_ANSWER, "11", "11 00000000000000")),
        "any bit timing": ("bit_timing", begun_otherwise(LSS_ANSWER, "13", "13 00000000000000")),
    },
}


def each(table):
    """Return the chapter, the checks and the defect of each entry."""
    return [
        pytest.param(chapter, *entry, id=name)
        for chapter, entries in table.items()
        for name, entry in entries.items()
    ]


@pytest.mark.parametrize(("chapter", "checks", "defect"), each(SAYS))
def test_what_it_says_wrongly_is_named(laboratory, chapter, checks, defect):
    laboratory.says = defect
    assert laboratory.failed_checks(chapter) == checks.split()


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


def hears_rpdos_in(state):
    """A defect: an RPDO acts in a state that an NMT command, also one to others, leads to."""
    last = b""

    def hears(frame):
        nonlocal last
        if frame.can_id == 0:
            last = frame.data
        if frame.can_id == RPDO and last[:1] == bytes([state]):
            return [Frame(0, b"\x01\x05"), frame, Frame(0, last)]
        return [frame]

    return hears


HEARS = {
    "NMT": {
        "obeys commands to others": ("other_node", hears_any_node),
        "obeys short ones": ("malformed", altered(0, lambda d: d + b"\x05" if len(d) == 1 else d)),
        "ignores those to all": ("broadcast", altered(0, lambda d: None if d[1:] == b"\0" else d)),
        "a reset restores nothing": (
            "reset_communication reset_restores",
            begun_otherwise(0, "8205", "8005"),
        ),
    },
    "Error control": {
        "heartbeat is never off": ("heartbeat_off", writes("2b171000 0000", "2b171000 0a00")),
        "does not know 1029h": ("error_behaviour", writes("2f291001 02", "2f291001 00")),
        "does not guard": ("guarding", lost(HEARTBEAT)),
        "does not watch heartbeats": ("heartbeat_consumer error_behaviour", lost(0x77F)),
    },
    "EMCY": {
        "is never off": ("switched_off", writes("23141000 85000080", "23141000 85000000")),
        "knows no inhibit time": ("inhibit_time", writes("2b151000 d007", "2b151000 0000")),
    },
    "SDO upload": {
        "takes 29-bit frames for its own": ("no_request", hears_extended),
        "answers short requests": ("no_request", pads_short_requests),
        "deaf to aborts": ("client_abort", lost(REQUEST, "80")),
        "serves any node-ID": (
            "other_node",
            lambda f: [f._replace(can_id=REQUEST)] if f.can_id == 0x67F else [f],
        ),
    },
    "SDO download": {
        "stores other bytes": (
            "segmented_long",
            altered(REQUEST, lambda d: b"\0!" + d[2:] if len(d) == 8 and d[0] == 0 else d),
        )
    },
    "PDO mapping": {
        "puts a dummy entry into an object": (
            "dummy",
            altered(RPDO, lambda d: d[1:] + b"\0" if d[:1] == b"\xff" else d),
        )
    },
    "TPDO": {
        "takes a reserved type": ("reserved_types", writes("2f001802 f1", "2f001802 01")),
        "remote frames by type 252 alone": ("remote_request", writes("2f001802 fd", "2f001802 f0")),
        "no events of type 255": (
            "event_timer inhibit_time",
            writes("2f001802 ff", "2f001802 01"),
        ),
        "does not leave OPERATIONAL": ("operational_only", begun_otherwise(0, "8005", "0105")),
    },
    "RPDO": {
        "hears none": (
            "asynchronous synchronous synchronous_window too_short too_long",
            lost(RPDO),
        ),
        "misses RPDOs too early": ("in_time", writes("2b001405 f401", "2b001405 0a00")),
        "takes 29-bit frames for its own RPDOs": ("strange_frames", hears_extended),
        "takes RPDOs in PRE-OPERATIONAL": ("rpdo_operational_only", hears_rpdos_in(0x80)),
        "takes RPDOs in STOPPED": ("rpdo_operational_only", hears_rpdos_in(0x02)),
        "takes short RPDOs": ("too_short", altered(RPDO, lambda d: d.ljust(4, b"\0"))),
    },
    "SYNC and TIME": {
        "keeps to the old SYNC": ("other_identifier", lost(0x6D2)),
        "takes a counter of 1": ("counter_limits", writes("2f191000 01", "2f191000 02")),
    },
    "Store and restore": {
        "stores another value": ("store restore", writes("2b171000 e110", "2b171000 0000")),
        "stores sub-index 2 by any word": (
            "wrong_signature",
            writes("23101002 6c6f6164", "23101002 73617665"),
        ),
        "forgets": ("store restore", writes("23101001 73617665", "40101001 00000000")),
    },
    "LSS": {
        "answers to any address": ("select_other", with_own_serial_number(0x43)),
        "is any address": ("identify", with_own_serial_number(0x4A, 0x4B)),
    },
}


@pytest.mark.parametrize(("chapter", "checks", "defect"), each(HEARS))
def test_what_it_hears_wrongly_is_named(laboratory, chapter, checks, defect):
    laboratory.hears = defect
    assert laboratory.failed_checks(chapter) == checks.split()


GENERAL, UNSUPPORTED, NO_OBJECT = 0x08000000, 0x06010000, 0x06020000
SPECIFIER, NOT_STORED = 0x05040001, 0x08000020


@pytest.mark.parametrize(
    ("chapter", "checks", "wrong", "instead_of"),
    [
        ("Object dictionary", "no_object write_nothing", GENERAL, right.NO_OBJECT),
        ("Object dictionary", "no_subindex write_nothing", NO_OBJECT, right.NO_SUBINDEX),
        ("Object dictionary", "write_only", UNSUPPORTED, right.WRITE_ONLY),
        ("Object dictionary", "read_only", UNSUPPORTED, right.READ_ONLY),
        ("Object dictionary", "limits", GENERAL, right.VALUE_TOO_HIGH),
        (
            "Object dictionary",
            "everything_readable history_beyond",
            GENERAL,
            right.NO_DATA,
        ),  # beyond the history's end
        ("SDO upload", "toggle", SPECIFIER, right.TOGGLE),
        (
            "SDO upload",
            "segment_without_transfer unknown_specifier fresh_server client_abort",
            GENERAL,
            right.COMMAND_SPECIFIER,
        ),
        ("SDO upload", "time_out", GENERAL, right.TIME_OUT),
        (
            "SDO download",
            "wrong_length more_than_announced announced_wrong",
            GENERAL,
            right.LENGTH_TOO_HIGH,
        ),
        ("SDO download", "wrong_length fewer_than_announced", GENERAL, right.LENGTH_TOO_LOW),
        ("SDO block transfer", "wrong_crc", GENERAL, right.CRC),
        ("SDO block transfer", "wrong_block_size", GENERAL, right.BLOCK_SIZE),
        ("SDO block transfer", "sequence_beyond segment_zero", GENERAL, right.SEQUENCE_NUMBER),
        ("PDO mapping", "no_object", GENERAL, right.NO_OBJECT),
        ("PDO mapping", "not_mappable", NO_OBJECT, right.NOT_MAPPABLE),
        ("SYNC and TIME", "counter_while_running", NOT_STORED, right.DEVICE_STATE),
        ("Store and restore", "wrong_signature", GENERAL, right.NOT_STORED),
    ],
)
def test_a_wrong_abort_code_is_named(laboratory, chapter, checks, wrong, instead_of):
    laboratory.says = aborted_otherwise(wrong, instead_of[0])
    assert laboratory.failed_checks(chapter) == checks.split()
