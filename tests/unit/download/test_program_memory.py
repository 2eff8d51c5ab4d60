"""Program download into a device: 0x1F50, 0x1F51, 0x1F56, 0x1F57 by CiA 302-3."""

import zlib

import pytest

from device_profiles import IMITATIONS
from hil_bench.abilities.download.program_memory import Checksum, MemoryConfig, program_memories
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.errors import SdoAbort

EDS = IMITATIONS / "programmable_io_401.eds"
STOP, START, RESET, CLEAR = 0, 1, 2, 3
# CiA 301: because of the present device state; hardware error; value; length too high.
STATE, HARDWARE, VALUE, TOO_LONG = 0x08000022, 0x06060000, 0x06090030, 0x06070012
MS = 1_000_000


class Device:
    def __init__(self, **config):
        self.objects = load_eds(EDS, 10)
        (self.memory,) = program_memories(self.objects, MemoryConfig(**config))

    def control(self, command):
        self.objects.download(0x1F51, 1, bytes([command]))

    def load(self, program):
        self.objects.download(0x1F50, 1, program)

    def cleared(self):
        self.control(STOP)
        self.control(CLEAR)
        return self

    @property
    def shown(self):
        """Program control, software identification, flash status."""
        return tuple(self.objects.number(index, 1) for index in (0x1F51, 0x1F56, 0x1F57))


def refused(code, action, *arguments):
    with pytest.raises(SdoAbort) as caught:
        action(*arguments)
    assert caught.value.code == code


def test_the_program_of_the_factory_runs():
    assert Device().shown == (1, 0x10000, 0)


def test_a_program_is_stopped_cleared_replaced_and_started():
    device = Device()
    device.control(STOP)
    assert device.shown == (0, 0x10000, 0)
    device.control(CLEAR)
    assert device.shown == (0, 0, 1 << 1)  # 1: no valid program
    device.load(b"123456789")
    device.memory.advance(0)
    # The CRC-32 of these nine characters is the check value of its catalogue.
    assert device.shown == (0, 0xCBF43926, 0)
    device.control(START)
    assert device.shown[0] == 1


def test_flashing_takes_its_time():
    device = Device(write_ns=5 * MS).cleared()
    device.load(b"1")
    device.memory.advance(10 * MS)
    assert device.shown[2] & 1
    for command in (START, CLEAR, STOP):
        refused(STATE, device.control, command)
    refused(STATE, device.load, b"2")
    device.memory.advance(14 * MS)
    assert device.shown[2] & 1
    device.memory.advance(15 * MS)
    assert device.shown[1:] == (zlib.crc32(b"1"), 0)


def test_what_needs_a_program_is_refused_without_one():
    device = Device().cleared()
    refused(STATE, device.control, START)
    refused(STATE, device.control, RESET)


def test_a_running_program_is_neither_cleared_nor_replaced():
    device = Device()
    refused(STATE, device.control, CLEAR)
    refused(STATE, device.load, b"1")
    assert device.shown == (1, 0x10000, 0)


def test_a_download_into_memory_that_was_not_cleared_is_refused():
    device = Device()
    device.control(STOP)
    refused(HARDWARE, device.load, b"1")
    assert device.shown[2] == 4 << 1  # 4: not cleared


def test_a_command_that_is_none_is_refused():
    refused(VALUE, Device().control, 4)


def test_a_program_that_does_not_fit_is_refused():
    device = Device(largest=4).cleared()
    device.load(b"1234")
    device = Device(largest=4).cleared()
    refused(TOO_LONG, device.load, b"12345")


def test_a_program_has_a_checksum_where_the_device_wants_one():
    device = Device(checksum=Checksum.CRC32).cleared()
    refused(HARDWARE, device.load, b"123456789\x26\x39\xf4\xcc")
    assert device.shown[2] == 3 << 1  # 3: checksum wrong
    device.control(CLEAR)
    device.load(b"123456789\x26\x39\xf4\xcb")
    device.memory.advance(0)
    assert device.shown == (0, 0xCBF43926, 0)


@pytest.mark.parametrize("data", [b"1", b"1234", b"\0\0\0\0"])
def test_a_checksum_alone_is_no_program(data):
    refused(HARDWARE, Device(checksum=Checksum.CRC32).cleared().load, data)


def test_a_reset_of_the_objects_is_none_of_the_program():
    device = Device().cleared()
    device.objects.restore(range(0x1000, 0x2000))
    device.memory.advance(0)
    assert device.shown == (0, 0, 1 << 1)
