"""What a PDO may carry, when it acts and when no more (CiA 301, process data objects)."""

import pytest

from hil_bench.canopen_device import datatypes
from hil_bench.canopen_device.datatypes import UNSIGNED32
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.node import Node
from hil_bench.canopen_device.object_dictionary import ObjectDictionary, Variable
from hil_bench.canopen_device.pdo_parameters import (
    Direction,
    MappingEntry,
    Seal,
    crc8,
    find_refusal,
)

NO_OBJECT, NOT_MAPPABLE = 0x06020000, 0x06040041
START = b"\x01\x05"


def refusal(dictionary, index, bits, direction=Direction.RPDO):
    """The abort code of a mapping entry, None where it may stand there."""
    found = find_refusal(dictionary, MappingEntry(index, 0, bits), direction)
    return None if found is None else found.abort[0]


# CiA 301, dummy mapping: objects 0x0001 (BOOLEAN) to 0x0007 (UNSIGNED32), in RPDOs.
@pytest.mark.parametrize(
    ("index", "bits", "code"),
    [
        *((0x0000, 8, NO_OBJECT), (0x0001, 1, None), (0x0002, 8, None), (0x0003, 16, None)),
        *((0x0004, 32, None), (0x0005, 8, None), (0x0006, 16, None), (0x0007, 32, None)),
        *((0x0008, 32, NO_OBJECT), (0x0007, 31, NOT_MAPPABLE), (0x0007, 0, NOT_MAPPABLE)),
    ],
)
def test_the_dummies_are_the_first_seven_types(index, bits, code):
    assert refusal(ObjectDictionary([]), index, bits) == code
    in_tpdo = NOT_MAPPABLE if 1 <= index <= 7 else NO_OBJECT
    assert refusal(ObjectDictionary([]), index, bits, Direction.TPDO) == in_tpdo


@pytest.mark.parametrize(
    ("bits", "code"),
    # One bit, or the byte that many devices give it.
    [
        (0, NOT_MAPPABLE),
        (1, None),
        (2, NOT_MAPPABLE),
        (7, NOT_MAPPABLE),
        (8, None),
        (9, NOT_MAPPABLE),
        (16, NOT_MAPPABLE),
    ],
)
def test_a_boolean_takes_a_bit_or_a_byte(bits, code):
    flag = Variable(0x2000, 0, "Flag", datatypes.BOOLEAN, mappable=True)
    assert refusal(ObjectDictionary([flag]), 0x2000, bits) == code


def test_a_synchronous_rpdo_acts_with_one_sync_and_no_other(rig):
    value = rig.node.object_dictionary.variable(0x2002)
    rig.receive(0x000, START)
    rig.receive(0x305, b"\x07\0\0\0")
    rig.receive(0x080, b"")
    assert value.value == 7
    value.value = 1  # the application sets it meanwhile
    rig.receive(0x080, b"")
    assert value.value == 1


def test_an_rpdo_that_waited_when_the_node_left_operational_is_forgotten(rig):
    rig.receive(0x000, START)
    rig.receive(0x305, b"\x07\0\0\0")
    rig.receive(0x000, b"\x80\x05")
    rig.receive(0x000, START)
    rig.receive(0x080, b"")
    assert rig.node.object_dictionary.variable(0x2002).value == 0


def times_out(rig, milliseconds):
    """Run some rounds of 1 ms; return in which an RPDO time-out (EMCY 8250) was sent."""
    return [
        number
        for number in range(1, milliseconds + 1)
        if any(f.can_id == 0x085 and f.data[:2] == b"\x50\x82" for f in rig.run())
    ]


def test_an_rpdo_times_out_once_at_its_time_after_the_last_one(rig):
    rig.node.object_dictionary.download(0x1400, 5, b"\x0a\0")  # event timer 10 ms
    rig.receive(0x000, START)
    assert times_out(rig, 30) == []  # the first one starts the supervision
    rig.receive(0x205, bytes(4))
    assert times_out(rig, 9) == []
    rig.receive(0x205, bytes(4))
    assert times_out(rig, 30) == [10]
    rig.receive(0x205, bytes(4))
    assert times_out(rig, 30) == [10]


def producer_by_default(object_dictionary, overflow=None):
    """A node that produces SYNC each 10 ms from its power-on."""
    kept = [v for v in object_dictionary if v.index not in {0x1005, 0x1006}]
    parameters = [
        Variable(0x1005, 0, "COB-ID SYNC", UNSIGNED32, default=0x40000080),
        Variable(0x1006, 0, "period", UNSIGNED32, default=10_000),
    ]
    node = Node(ObjectDictionary([*kept, *parameters]), 5)
    if overflow is not None:
        node.object_dictionary.variable(0x1019).value = overflow
    return node


def test_a_producer_by_default_sends_sync_from_its_boot_up_on(object_dictionary):
    node, sent = producer_by_default(object_dictionary), []
    node.start(0)
    for millisecond in range(25):
        now = millisecond * 1_000_000
        node.expire(now)
        node.transmit_pdos(now, lambda frame, ms=millisecond: sent.append((ms, frame)))
        node.serve(now, [].append)
    # Booted in round 0, at once in the next, then each 10 ms.
    assert sent == [(ms, Frame(0x080)) for ms in (1, 11, 21)]


def test_the_counter_of_a_sync_is_its_first_byte(rig):
    dictionary = rig.node.object_dictionary
    dictionary.download(0x1019, 0, b"\x08")
    for subindex, value, size in ((1, 0x80000285, 4), (6, 3, 1), (2, 1, 1), (1, 0x285, 4)):
        dictionary.download(0x1801, subindex, value.to_bytes(size, "little"))
    rig.receive(0x000, START)
    rig.run()
    rig.receive(0x080, b"\x02\x03")  # a byte too many: an error, and acted on all the same
    assert 0x285 not in [frame.can_id for frame in rig.run()]
    rig.receive(0x080, b"\x03\x02")
    assert 0x285 in [frame.can_id for frame in rig.run()]


# TPDOs with counter and checksum.
#
# CRC-8 SAE J1850 of the ASCII digits 1 to 9 is 0x4B (its published check value); of no byte it is
# the initial value inverted, 0x00.


DIGITS = b"123456789"


def test_the_checksum_has_its_published_check_value():
    assert crc8(DIGITS) == 0x4B
    assert crc8(b"") == 0x00


def test_the_counter_goes_round():
    seal = Seal()
    counters = [seal.close(0x184, b"abc")[3] for _ in range(257)]
    assert counters == [*range(256), 0]


def test_identifier_data_and_counter_count():
    sealed = Seal().close(0x184, b"abc")
    assert sealed == b"abc\0" + bytes((crc8(b"\x84\x01abc\0"),))


def test_every_single_bit_shows():
    sealed = int.from_bytes(Seal().close(0x184, b"abc"), "little")
    spoiled = [(sealed ^ 1 << bit).to_bytes(5, "little") for bit in range(40)]
    assert [each for each in spoiled if crc8(b"\x84\x01" + each[:-1]) == each[-1]] == []
