"""Requests, responses, and what becomes of a link that is lost."""

import math
import socket
import threading

import pytest
from support.patience import GUARD

from hil_drivers import BusLostError, DriverTimeoutError, ModbusExceptionError, RemoteProtocolError
from hil_drivers.modbus import ModbusClient, SerialLink, TcpLink
from hil_drivers.modbus.client import FIRST_BACKOFF, LAST_BACKOFF
from hil_drivers.modbus.framing import RtuFraming, check_sum


def tcp(transaction, pdu, unit_id=17):
    pdu = bytes.fromhex(pdu)
    return bytes([0, transaction, 0, 0, 0, len(pdu) + 1, unit_id]) + pdu


def rtu(pdu, unit_id=17):
    body = bytes([unit_id]) + bytes.fromhex(pdu)
    return body + check_sum(body)


# The examples of MODBUS Application Protocol V1.1b3, 6.3, 6.12, 6.5 and 6.1.
def test_the_requests_are_those_of_the_specification(link, client):
    link.play(
        tcp(1, "03 06 022B 0000 0064"),
        tcp(2, "10 0001 0002"),
        tcp(3, "05 00AC FF00"),
        tcp(4, "01 01 01"),
        tcp(5, "02 01 00"),
    )
    assert client.read_registers(17, "holding_registers", 0x6B, 3) == [0x22B, 0, 0x64]
    client.write_registers(17, 1, [0x0A, 0x0102])
    client.write_coil(17, 0xAC, on=True)
    assert client.read_bit(17, "coils", 0x13) is True
    assert client.read_bit(17, "discrete_inputs", 0x13) is False
    assert link.sent == [
        tcp(1, "03 006B 0003"),
        tcp(2, "10 0001 0002 04 000A 0102"),
        tcp(3, "05 00AC FF00"),
        tcp(4, "01 0013 0001"),
        tcp(5, "02 0013 0001"),
    ]


def test_the_identification(link, client):
    link.play(tcp(1, "2B 0E 01 82 00 00 02 00 02 6162 01 01 63"))
    assert client.read_identification(17) == {0: "ab", 1: "c"}
    assert link.sent == [tcp(1, "2B 0E 01 00")]


@pytest.mark.parametrize(
    "response",
    [
        [b"\0\1\0\0\0\7\x11", b"\4\4\0\1\0\2"],
        [bytes([byte]) for byte in tcp(1, "04 04 0001 0002")],
        [tcp(0, "04 04 0009 0009") + tcp(1, "04 04 0001 0002")],  # a late one before it
        [tcp(1, "04 04 0009 0009", 3) + tcp(1, "04 04 0001 0002")],  # of another unit
    ],
)
def test_a_response_is_put_together_and_a_late_one_passed_over(link, client, response):
    link.play(response)
    assert client.read_registers(17, "input_registers", 0, 2) == [1, 2]


@pytest.mark.parametrize(
    "response",
    [
        [rtu("04 04 0001 0002")],
        [b"\xff\x00" + rtu("04 04 0001 0002")],
        [rtu("04 04 0001 0002")[:3], rtu("04 04 0001 0002")[3:]],
        [rtu("04 04 0009 0009", 3) + rtu("04 04 0001 0002")],
    ],
)
def test_the_same_on_a_serial_line(link, client, response):
    link.framing = RtuFraming()
    link.play(response)
    assert client.read_registers(17, "input_registers", 0, 2) == [1, 2]
    assert link.sent == [rtu("04 0000 0002")]


def test_an_identification_on_a_serial_line(link, client):
    link.framing = RtuFraming()
    whole = rtu("2B 0E 01 82 00 00 02 00 02 6162 01 01 63")
    link.play([whole[:9], whole[9:11], whole[11:]])
    assert client.read_identification(17) == {0: "ab", 1: "c"}


@pytest.mark.parametrize(
    ("code", "meaning"),
    [
        (1, "illegal function"),
        (2, "illegal data address"),
        (3, "illegal data value"),
        (4, "server device failure"),
        (5, "acknowledge"),
        (6, "server device busy"),
        (8, "memory parity error"),
        (10, "gateway path unavailable"),
        (11, "gateway target device failed to respond"),
        (7, "unknown"),
    ],
)
def test_a_refusal_names_code_and_meaning(link, client, code, meaning):
    """The codes of MODBUS Application Protocol V1.1b3, 7."""
    link.play(tcp(1, f"84 {code:02x}"))
    with pytest.raises(ModbusExceptionError) as caught:
        client.read_registers(17, "input_registers", 0, 2)
    assert caught.value.code == code
    assert str(caught.value) == (
        f"unit 17 at transcript: function 4 refused: exception {code}, {meaning}"
    )


@pytest.mark.parametrize(
    "pdu",
    [
        "04 02 0001",  # one register of two
        "04 04 0001",
        "03 04 0001 0002",  # another function
        "84 02 00",
        "84",
    ],
)
def test_a_response_that_does_not_answer_is_an_error(link, client, pdu):
    link.play(tcp(1, pdu))
    with pytest.raises(RemoteProtocolError):
        client.read_registers(17, "input_registers", 0, 2)


@pytest.mark.parametrize("pdu", ["2B 0E 01 82 00 00 02 00 02 61", "2B 0E 01", "2B 0E 01 82 00 00"])
def test_a_malformed_identification_is_an_error(link, client, pdu):
    link.play(tcp(1, pdu))
    with pytest.raises(RemoteProtocolError):
        client.read_identification(17)


def test_what_is_no_modbus_ends_the_connection(link, client):
    link.play(b"HTTP/1.1 400 Bad Request")
    with pytest.raises(RemoteProtocolError, match="not a Modbus TCP header"):
        client.read_registers(17, "input_registers", 0, 2)
    link.play(tcp(2, "04 04 0001 0002"))
    assert client.read_registers(17, "input_registers", 0, 2) == [1, 2]
    assert link.opened == 2


def test_silence_is_a_time_out_and_the_link_stays(link, client):
    link.play(None)
    with pytest.raises(DriverTimeoutError, match=r"unit 17 at transcript: no response within 0\.2"):
        client.read_registers(17, "input_registers", 0, 2)
    assert link.time == pytest.approx(100.2)
    link.play(tcp(2, "04 04 0001 0002"))
    assert client.read_registers(17, "input_registers", 0, 2) == [1, 2]
    assert link.opened == 1


def test_noise_without_end_is_a_time_out_too(link, client):
    link.framing = RtuFraming()
    link.play([b"\x11\x04\x04" * 200] * 50)
    with pytest.raises(DriverTimeoutError):
        client.read_registers(17, "input_registers", 0, 2)


def read(client):
    return client.read_registers(17, "input_registers", 0, 2)


def test_a_lost_link_is_opened_again_after_a_back_off_that_doubles(link, client):
    link.play(ConnectionResetError(104, "Connection reset by peer"))
    with pytest.raises(BusLostError, match="transcript: Connection reset by peer"):
        read(client)
    link.refuses = True
    backoff = FIRST_BACKOFF
    for _ in range(12):
        with pytest.raises(BusLostError, match="the next attempt is in"):
            read(client)
        link.time += backoff * 0.99
        with pytest.raises(BusLostError, match="the next attempt is in"):
            read(client)
        link.time += backoff * 0.02
        with pytest.raises(BusLostError, match="Connection refused"):
            read(client)
        backoff = min(2 * backoff, LAST_BACKOFF)
    assert backoff == LAST_BACKOFF
    link.refuses = False
    link.time += LAST_BACKOFF + 0.01
    link.play(tcp(2, "04 04 0001 0002"))
    assert read(client) == [1, 2]
    # From the first back-off again.
    link.play(ConnectionResetError(104, "Connection reset by peer"))
    with pytest.raises(BusLostError):
        read(client)
    link.time += FIRST_BACKOFF * 1.01
    link.play(tcp(4, "04 04 0001 0002"))
    assert read(client) == [1, 2]


def test_a_link_lost_while_waiting_is_lost(link, client):
    link.play([b"\0\1", ConnectionResetError("gone")])
    with pytest.raises(BusLostError, match="gone"):
        read(client)


def test_a_device_behind_a_real_connection_that_breaks():
    """Answers one request, hangs up, and is there again."""

    def serve(listener):
        for transaction in (1, 3):
            with listener.accept()[0] as connection:
                connection.recv(64)
                connection.sendall(tcp(transaction, "04 04 0001 0002"))

    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=serve, args=(listener,))
        thread.start()
        link = TcpLink("127.0.0.1", listener.getsockname()[1])
        with ModbusClient(link, timeout=GUARD) as client:
            assert read(client) == [1, 2]
            with pytest.raises(BusLostError):
                read(client)
            client._retry_at = -math.inf  # the back-off is over
            assert read(client) == [1, 2]
        thread.join()


def test_a_port_that_nobody_listens_on():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    with ModbusClient(TcpLink("127.0.0.1", port)) as client, pytest.raises(BusLostError):
        read(client)


def test_a_serial_port_that_is_not_there(tmp_path):
    client = ModbusClient(SerialLink(str(tmp_path / "port")))
    with pytest.raises(BusLostError, match="No such file"):
        read(client)


@pytest.mark.parametrize("link_type", [TcpLink, SerialLink])
def test_a_link_that_is_not_open_says_so(link_type):
    link = link_type("nowhere")
    with pytest.raises(ConnectionError):
        link.send(b"x")
    with pytest.raises(ConnectionError):
        link.receive(0.1)
    link.close()


def test_the_check_sum():
    # CRC-16/MODBUS in the catalogue of CRC algorithms: check 0x4B37 for "123456789".
    assert check_sum(b"123456789") == bytes.fromhex("374B")
