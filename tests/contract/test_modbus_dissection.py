"""What Wireshark's Modbus dissectors read in a recorded session, of TCP and of RTU."""

import contextlib

import pytest
from support.dissection import dissect, require_tshark, write_tcp_capture

from hil_bench import VirtualBench, load_config
from hil_drivers import DriverError
from hil_drivers.modbus import ModbusClient, PositionSensor, PressureSensor, ProportionalValve
from hil_drivers.modbus.framing import RtuFraming, TcpFraming

UNITS = (
    "[modbus.units.valve]\ncommands = true\n[modbus.units.pressure_a]\n[modbus.units.position]\n"
)


@pytest.fixture(scope="module", autouse=True)
def _tshark():
    require_tshark()


class RecordedLink:
    """Writes down what passes a link."""

    def __init__(self, link):
        self.messages = []
        self._link = link

    def __getattr__(self, name):
        return getattr(self._link, name)

    def send(self, data):
        self.messages.append((True, bytes(data)))
        self._link.send(data)

    def receive(self, timeout):
        data = self._link.receive(timeout)
        if data:
            self.messages.append((False, data))
        return data


def record(tmp_path, *, is_serial):
    """A session with every function, and four exceptions; the messages as they passed."""
    path = tmp_path / "bench.toml"
    path.write_text(UNITS)
    with VirtualBench(load_config(path)) as bench:
        bench.run(0.005)
        framing = RtuFraming() if is_serial else TcpFraming()
        link = RecordedLink(bench.modbus_link(framing, is_serial=is_serial))
        client = ModbusClient(link, clock=bench.now)
        PressureSensor(client, 2).setup()
        PositionSensor(client, 4).setup()
        with ProportionalValve(client, 1) as valve:
            valve.setup()
            valve.enable()
            valve.spool_setpoint = 0.25
        client.read_bit(2, "discrete_inputs", 0)
        client.read_bit(1, "coils", 0)
        client.read_registers(2, "holding_registers", 1, 1)
        client.request(2, bytes.fromhex("06 0001 0002"))
        client.request(1, bytes.fromhex("0F 0000 0001 01 00"))
        for refused in ("08 0000 0000", "04 0000 0001", "06 0001 0000", "05 0001 FF00"):
            unit_id = 1 if refused.startswith("05") else 2
            with contextlib.suppress(DriverError):
                client.request(unit_id, bytes.fromhex(refused))
        return link.messages


@pytest.mark.parametrize("is_serial", [False, True], ids=["tcp", "rtu"])
def test_each_frame_is_what_it_was_meant_to_be(tmp_path, is_serial):
    messages = record(tmp_path, is_serial=is_serial)
    capture = tmp_path / "session.pcap"
    write_tcp_capture(capture, messages)
    protocol = "mbrtu" if is_serial else "mbtcp"
    rows = dissect(
        capture,
        "_ws.malformed",
        "mbrtu.crc16.incorrect" if is_serial else "mbtcp.cannot_classify",
        f"{protocol}.unit_id",
        "modbus.func_code",
        "modbus.exception_code",
        decode_as=f"tcp.port==502,{protocol}",
    )
    assert len(rows) == len(messages)
    assert {row[:2] for row in rows} == {("", "")}
    start = 0 if is_serial else 6
    for (_, data), (_, _, unit_id, function, _) in zip(messages, rows, strict=True):
        assert int(unit_id) == data[start]
        assert int(function) == data[start + 1] & 0x7F
    functions = {int(row[3]) for row in rows}
    assert functions == {1, 2, 3, 4, 5, 6, 8, 15, 16, 43}
    # Function 8, half a value, a value that the device refuses, a command without control.
    assert [row[4] for row in rows if row[4]] == ["1", "2", "3", "4"]


def test_every_response_is_found_to_its_request(tmp_path):
    messages = record(tmp_path, is_serial=False)
    capture = tmp_path / "session.pcap"
    write_tcp_capture(capture, messages)
    rows = dissect(
        capture, "modbus.request_frame", "modbus.exception_code", decode_as="tcp.port==502,mbtcp"
    )
    for number, ((is_request, _), (request, exception)) in enumerate(
        zip(messages, rows, strict=True), 1
    ):
        expected = "" if is_request else str(number - 1)
        # Wireshark 4.0 gives an exception no request; later versions may.
        assert request == expected or (exception and not request)


def test_registers_are_read_as_the_values_that_they_are(tmp_path):
    messages = record(tmp_path, is_serial=False)
    capture = tmp_path / "session.pcap"
    write_tcp_capture(capture, messages)
    (row, *_) = dissect(
        capture,
        "modbus.regval_uint16",
        only="mbtcp.unit_id == 2 && modbus.func_code == 4 && modbus.request_frame",
        decode_as="tcp.port==502,mbtcp",
    )
    data = next(data for asks, data in messages if not asks and data[6:8] == b"\x02\x04")
    words = [int.from_bytes(data[place : place + 2], "big") for place in range(9, len(data), 2)]
    assert [int(word) for word in row[0].split(",")] == words
