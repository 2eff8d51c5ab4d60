"""Requests and responses, byte by byte; the frames are written out from the specification's tables.

MODBUS Application Protocol Specification V1.1b3, 6.1 to 6.12 and 6.21.
"""

from dataclasses import replace

import pytest

from hil_bench.abilities.modbus.protocol.register_map import (
    DeviceIdentification,
    ExceptionCode,
    ModbusException,
    Table,
)
from hil_bench.abilities.modbus.server.pdu import (
    Request,
    _is_well_formed,
    decode_request,
    encode_exception,
    encode_response,
    identify,
)

IDENTIFICATION = DeviceIdentification("maker", "PT-1", "1.0", product_name="sensor")


# The examples of the specification: 6.1, 6.2, 6.3, 6.4, 6.5, 6.6, 6.11, 6.12, 6.16, 6.17.
@pytest.mark.parametrize(
    ("pdu", "request_", "words", "response"),
    [
        (
            "01 0013 0013",
            Request(1, Table.COILS, 0x13, 19),
            [1, 0, 1, 1, 0, 0, 1, 1, 1, 1, 0, 1, 0, 1, 1, 0, 1, 0, 1],
            "01 03 CD 6B 05",
        ),
        (
            "02 00C4 0016",
            Request(2, Table.DISCRETE_INPUTS, 0xC4, 22),
            [0, 0, 1, 1, 0, 1, 0, 1, 1, 1, 0, 1, 1, 0, 1, 1, 1, 0, 1, 0, 1, 1],
            "02 03 AC DB 35",
        ),
        (
            "03 006B 0003",
            Request(3, Table.HOLDING_REGISTERS, 0x6B, 3),
            [0x022B, 0, 0x64],
            "03 06 022B 0000 0064",
        ),
        ("04 0008 0001", Request(4, Table.INPUT_REGISTERS, 8, 1), [0x0A], "04 02 000A"),
        ("05 00AC FF00", Request(5, Table.COILS, 0xAC, 1, [1]), [], "05 00AC FF00"),
        ("05 00AC 0000", Request(5, Table.COILS, 0xAC, 1, [0]), [], "05 00AC 0000"),
        ("06 0001 0003", Request(6, Table.HOLDING_REGISTERS, 1, 1, [3]), [], "06 0001 0003"),
        (
            "0F 0013 000A 02 CD01",
            Request(15, Table.COILS, 0x13, 10, [1, 0, 1, 1, 0, 0, 1, 1, 1, 0]),
            [],
            "0F 0013 000A",
        ),
        (
            "10 0001 0002 04 000A 0102",
            Request(16, Table.HOLDING_REGISTERS, 1, 2, [0x0A, 0x0102]),
            [],
            "10 0001 0002",
        ),
        (
            "16 0004 00F2 0025",
            Request(22, Table.HOLDING_REGISTERS, 4, 1, [0xF2, 0x25]),
            [],
            "16 0004 00F2 0025",
        ),
        (
            "17 0003 0006 000E 0003 06 00FF 00FF 00FF",
            Request(23, Table.HOLDING_REGISTERS, 14, 3, [0xFF, 0xFF, 0xFF], 3, 6),
            [0x00FE, 0x0ACD, 1, 3, 0x000D, 0x00FF],
            "17 0C 00FE 0ACD 0001 0003 000D 00FF",
        ),
    ],
)
def test_the_examples_of_the_specification(pdu, request_, words, response):
    decoded = decode_request(bytes.fromhex(pdu))
    assert replace(decoded, words=list(decoded.words)) == replace(
        request_, words=list(request_.words)
    )
    assert encode_response(request_, words) == bytes.fromhex(response)


@pytest.mark.parametrize("function", [0, 7, 8, 9, 14, 17, 20, 21, 24, 65, 100, 127, 128, 255])
def test_any_other_function_is_illegal(function):
    with pytest.raises(ModbusException) as caught:
        decode_request(bytes([function, 0, 0, 0, 1]))
    assert caught.value.code is ExceptionCode.ILLEGAL_FUNCTION


@pytest.mark.parametrize(
    "pdu",
    [
        "03 0000 0000",  # none
        "03 0000 007E",  # 126, one more than 6.3 allows
        "04 0000 FFFF",
        "01 0000 07D1",  # 2001, one more than 6.1 allows
        "03 0000",
        "03",
        "03 0000 0001 00",
        "05 0000 0001",  # neither 0000 nor FF00
        "05 0000 FF01",
        "06 0000",
        "0F 0000 0000 00",
        "0F 0000 0009 01 FF",  # nine coils in one byte
        "0F 0000 0008 02 FFFF",
        "10 0000 0001 04 0000 0000",
        "10 0000 0002 04 0000",
        "10 0000 0001 02",
        "10 0000 007C F8" + 248 * "00",  # 124, one more than 6.12 allows
        "10 0000",
        "16 0004 00F2",
        "16 0004 00F2 0025 00",
        "17 0003 0000 000E 0001 02 00FF",  # reads none
        "17 0003 0001 000E 0000 00",  # writes none
        "17 0003 0001 000E 0001 04 00FF 00FF",
        "17 0003 0001 000E 0001 02",
        "17 0003 0001 000E",
    ],
)
def test_a_wrong_count_length_or_value_is_illegal(pdu):
    with pytest.raises(ModbusException) as caught:
        decode_request(bytes.fromhex(pdu))
    assert caught.value.code is ExceptionCode.ILLEGAL_DATA_VALUE


def coils(count):
    size = (count + 7) // 8
    return bytes.fromhex("0F 0000") + count.to_bytes(2, "big") + bytes([size]) + bytes(size)


def registers(count):
    return (
        bytes.fromhex("10 0000") + count.to_bytes(2, "big") + bytes([2 * count]) + bytes(2 * count)
    )


def both(read, written):
    counts = read.to_bytes(2, "big") + bytes(2) + written.to_bytes(2, "big")
    return bytes.fromhex("17 0000") + counts + bytes([2 * written]) + bytes(2 * written)


def read_of(function):
    return lambda count: bytes([function, 0, 0]) + count.to_bytes(2, "big")


# Largest counts: 0x07D0 in 6.1 and 6.2, 0x007D in 6.3 and 6.4, 0x07B0 in 6.11, 0x007B in 6.12,
# 0x7D read and 0x79 written in 6.17.
@pytest.mark.parametrize(
    ("make", "most", "field"),
    [
        (read_of(1), 2000, "count"),
        (read_of(2), 2000, "count"),
        (read_of(3), 125, "count"),
        (read_of(4), 125, "count"),
        (coils, 1968, "count"),
        (registers, 123, "count"),
        (lambda count: both(count, 1), 125, "read_count"),
        (lambda count: both(1, count), 121, "count"),
    ],
    ids=["1", "2", "3", "4", "15", "16", "23 read", "23 write"],
)
def test_the_largest_and_the_smallest_count_of_each_function(make, most, field):
    for count in (1, most):
        assert getattr(decode_request(make(count)), field) == count
    for count in (0, most + 1):
        with pytest.raises(ModbusException) as caught:
            decode_request(make(count))
        assert caught.value.code is ExceptionCode.ILLEGAL_DATA_VALUE
        assert not _is_well_formed(make(count))  # whatever pymodbus has to say about it


def test_the_largest_writes_carry_all_they_say():
    assert len(decode_request(coils(1968)).words) == 1968
    assert len(decode_request(registers(123)).words) == 123
    assert len(decode_request(both(125, 121)).words) == 121


@pytest.mark.parametrize(("function", "most", "size"), [(1, 2000, 252), (3, 125, 252)])
def test_the_largest_responses_fit_into_a_pdu(function, most, size):
    request = decode_request(bytes([function, 0, 0]) + most.to_bytes(2, "big"))
    assert len(encode_response(request, [1] * most)) == size


def test_an_exception_carries_the_function_and_the_code():
    assert encode_exception(3, ExceptionCode.ILLEGAL_DATA_ADDRESS) == bytes.fromhex("83 02")
    assert encode_exception(0xFF, ExceptionCode.ILLEGAL_FUNCTION) == bytes.fromhex("FF 01")


# 6.21: MEI type, code, conformity, more follows, next object, number of objects, the objects.
BASIC = "00 05 6D616B6572 01 04 50542D31 02 03 312E30"


@pytest.mark.parametrize(
    ("pdu", "response"),
    [
        ("2B 0E 01 00", "2B 0E 01 82 00 00 03" + BASIC),
        ("2B 0E 01 01", "2B 0E 01 82 00 00 02" + BASIC[17:]),
        ("2B 0E 01 7F", "2B 0E 01 82 00 00 03" + BASIC),  # unknown: from the first
        ("2B 0E 02 00", "2B 0E 02 82 00 00 04" + BASIC + "04 06 73656E736F72"),
        ("2B 0E 03 00", "2B 0E 03 82 00 00 04" + BASIC + "04 06 73656E736F72"),
        ("2B 0E 04 02", "2B 0E 04 82 00 00 01 02 03 312E30"),
    ],
)
def test_the_device_identification(pdu, response):
    assert identify(bytes.fromhex(pdu), IDENTIFICATION) == bytes.fromhex(response)


@pytest.mark.parametrize(
    ("pdu", "code"),
    [
        ("2B", ExceptionCode.ILLEGAL_FUNCTION),
        ("2B 0D 01 00", ExceptionCode.ILLEGAL_FUNCTION),
        ("2B 0E 00 00", ExceptionCode.ILLEGAL_DATA_VALUE),
        ("2B 0E 05 00", ExceptionCode.ILLEGAL_DATA_VALUE),
        ("2B 0E 01", ExceptionCode.ILLEGAL_DATA_VALUE),
        ("2B 0E 04 03", ExceptionCode.ILLEGAL_DATA_ADDRESS),
        ("2B 0E 04 80", ExceptionCode.ILLEGAL_DATA_ADDRESS),
    ],
)
def test_a_wrong_request_for_the_identification(pdu, code):
    with pytest.raises(ModbusException) as caught:
        identify(bytes.fromhex(pdu), IDENTIFICATION)
    assert caught.value.code is code


def test_more_objects_than_fit_are_told_to_follow():
    long = DeviceIdentification(*("x" * 64 for _ in range(7)))
    response = identify(bytes.fromhex("2B 0E 02 00"), long)
    assert len(response) <= 253
    # Three objects of 66 bytes fit into 247; object 3 is where to go on.
    assert response[3:7] == bytes([0x82, 0xFF, 3, 3])
    rest = identify(bytes([0x2B, 0x0E, 2, response[5]]), long)
    assert rest[7] == 3
