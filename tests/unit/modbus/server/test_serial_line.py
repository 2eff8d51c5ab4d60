"""A line over a pseudo-terminal."""

import asyncio
import os
import tty

import pytest

from hil_bench.abilities.modbus.protocol.register_map import Parity, SerialConfig
from hil_bench.abilities.modbus.server import serial_line
from hil_bench.abilities.modbus.server.serial_line import SerialLine, open_serial
from hil_bench.abilities.modbus.server.session import crc16
from hil_bench.errors import BusError

READ = bytes.fromhex("01 04 0000 0002")
ANSWER = bytes.fromhex("01 04 04 0001 0002")


def framed(body):
    return body + crc16(body)


def config(port="pty"):
    return SerialConfig(port, 19200, Parity.EVEN, 1)


@pytest.fixture
async def line(rig):
    line = SerialLine(config(), rig.server)
    yield line
    line.close()


@pytest.fixture
async def client(line):
    """The other end of the line."""
    client = os.open(line.name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    tty.setraw(client)
    yield client
    os.close(client)


async def receive(client, size):
    data = b""
    while len(data) < size:
        await asyncio.sleep(0)
        try:
            data += os.read(client, size - len(data))
        except BlockingIOError:
            continue
    return data


@pytest.mark.anyio
async def test_a_request_is_answered(client):
    os.write(client, framed(READ))
    assert await receive(client, 9) == framed(ANSWER)


@pytest.mark.anyio
async def test_silence_ends_a_request_that_lost_bytes(client, line):
    whole = framed(bytes.fromhex("01 10 0000 0002 04 00010002"))
    os.write(client, whole[:-3])
    while not line._session._buffer:
        await asyncio.sleep(0)
    while line._session._buffer:
        await asyncio.sleep(0)
    os.write(client, framed(READ))
    assert await receive(client, 9) == framed(ANSWER)


def test_a_port_that_is_not_there_is_a_line(tmp_path):
    with pytest.raises(BusError, match=r"modbus serial port .*nothing: cannot be opened: .*; give"):
        open_serial(config(str(tmp_path / "nothing")))


@pytest.mark.parametrize(
    ("rate", "parity", "letter", "stop_bits"),
    [(19200, Parity.EVEN, "E", 1), (9600, Parity.NONE, "N", 2), (115200, Parity.ODD, "O", 1)],
)
def test_a_port_has_the_settings_of_its_table_and_waits_for_nothing(
    rate, parity, letter, stop_bits
):
    ours, theirs = os.openpty()
    try:
        port = open_serial(SerialConfig(os.ttyname(theirs), rate, parity, stop_bits))
        assert (port.baudrate, port.parity, port.stopbits) == (rate, letter, stop_bits)
        assert (port.timeout, port.exclusive) == (0, True)
        port.close()
    finally:
        os.close(ours)
        os.close(theirs)


@pytest.mark.anyio
async def test_a_port_is_opened_as_configured(rig):
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    os.set_blocking(ours, False)
    line = SerialLine(config(os.ttyname(theirs)), rig.server)
    try:
        assert line.name == os.ttyname(theirs)
        os.write(ours, framed(READ))
        assert await receive(ours, 9) == framed(ANSWER)
    finally:
        line.close()
        os.close(ours)
        os.close(theirs)


@pytest.mark.anyio
async def test_a_port_that_is_lost_is_tried_again(rig, monkeypatch, tmp_path):
    monkeypatch.setattr(serial_line, "RETRY", 0.0)
    link = tmp_path / "port"
    ours, theirs = os.openpty()
    link.symlink_to(os.ttyname(theirs))
    os.close(theirs)
    line = SerialLine(config(str(link)), rig.server)
    os.close(ours)  # the adapter is pulled out
    link.unlink()
    while line._device is not None:
        await asyncio.sleep(0)
    again, its_end = os.openpty()
    tty.setraw(its_end)
    os.set_blocking(again, False)
    link.symlink_to(os.ttyname(its_end))
    while line._device is None:
        await asyncio.sleep(0)
    os.write(again, framed(READ))
    assert await receive(again, 9) == framed(ANSWER)
    line.close()
    os.close(again)
    os.close(its_end)
