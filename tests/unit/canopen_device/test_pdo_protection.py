"""TPDOs with counter and checksum.

CRC-8 SAE J1850 of the ASCII digits 1 to 9 is 0x4B (its published check value); of no byte it is
the initial value inverted, 0x00.
"""

import pytest

from hil_bench.canopen_device.pdo_parameters import Seal, crc8

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


@pytest.mark.parametrize("bit", range(40))
def test_every_single_bit_shows(bit):
    sealed = int.from_bytes(Seal().close(0x184, b"abc"), "little")
    spoiled = (sealed ^ 1 << bit).to_bytes(5, "little")
    assert crc8(b"\x84\x01" + spoiled[:-1]) != spoiled[-1]
