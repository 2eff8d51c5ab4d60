"""mbpoll, which is libmodbus, as the client: over TCP and over RTU."""

import re
import subprocess

import pytest
from support.dissection import require_tool
from support.patience import GUARD

from hil_drivers.modbus import ModbusClient, PositionSensor, PressureSensor, TcpLink

pytestmark = pytest.mark.long


@pytest.fixture(scope="module", autouse=True)
def _mbpoll():
    require_tool("mbpoll")


@pytest.fixture(params=["tcp", "rtu"])
def mbpoll(request, bench_endpoints):
    """Runs mbpoll once on a unit; gives exit code, the values that it printed, and its words."""
    if request.param == "tcp":
        way, place = ["-m", "tcp", "-p", str(bench_endpoints.modbus_port)], "127.0.0.1"
    else:
        way, place = ["-m", "rtu", "-b", "19200", "-P", "none"], bench_endpoints.serial_port

    def run(unit_id, kind, address, *, count=1, write=()):
        # Time-out 10 s: a shared machine may hold the server up.
        options = ["-1", "-0", "-B", "-o", "10", "-a", str(unit_id), "-t", kind]
        values = ["--", *map(str, write)] if write else ["-c", str(count)]
        where = ["-r", str(address)]
        command = ["mbpoll", *way, *options, *where]
        command += [place, *values] if write else [*values, place]
        done = subprocess.run(  # noqa: S603 - mbpoll, with arguments of our own
            command, capture_output=True, text=True, check=False
        )
        found = [
            float(value) for value in re.findall(r"^\[\d+\]:\s+(\S+)", done.stdout, re.MULTILINE)
        ]
        return done.returncode, found, done.stdout + done.stderr

    return run


@pytest.fixture
def client(bench_endpoints):
    with ModbusClient(TcpLink("127.0.0.1", bench_endpoints.modbus_port), timeout=GUARD) as client:
        yield client


def test_it_reads_what_the_drivers_read(mbpoll, client):
    pressure, position = PressureSensor(client, 2), PositionSensor(client, 4)
    # Read at once: mbpoll may take longer than a value stays fresh.
    pressure.poll()
    expected_pressure = pressure.pressure
    position.poll()
    expected_position = position.position
    # The piston is at rest; mbpoll prints six digits.
    code, (value,), _ = mbpoll(2, "3:float", 0)
    assert (code, value * 1e5) == (0, pytest.approx(expected_pressure, rel=1e-4))
    code, (pascal,), _ = mbpoll(2, "3:int", 6)
    assert (code, pascal) == (0, pytest.approx(expected_pressure, rel=1e-4))
    code, (millimetres,), _ = mbpoll(4, "3:float", 0)
    assert (code, millimetres * 1e-3) == (0, pytest.approx(expected_position, abs=1e-4))
    code, bits, _ = mbpoll(2, "1", 0, count=3)
    assert (code, bits) == (0, [1, 0, 0])


def test_values_of_one_request_are_of_one_tick(mbpoll):
    # Position in mm as a float, then in um as an integer: registers 0 and 7 of the encoder's map.
    code, words, _ = mbpoll(4, "3", 0, count=9)
    assert code == 0
    assert len(words) == 9


def test_the_other_word_order(mbpoll):
    _, (high, low), _ = mbpoll(2, "3", 6, count=2)
    _, swapped, _ = mbpoll(12, "3", 6, count=2)
    assert swapped[1] == high
    assert swapped[0] == pytest.approx(low, abs=2000)  # of Pa, from one request to the next


def test_it_writes_configuration(mbpoll):
    for value in (7, 1):
        code, _, _ = mbpoll(2, "4", 1, write=[value])
        assert code == 0
        assert mbpoll(2, "4", 1)[:2] == (0, [value])


def test_it_commands_the_valve(mbpoll):
    control, enable = 0, 1
    assert mbpoll(1, "4", 3, write=[0])[0] == 0  # no watchdog
    assert mbpoll(1, "0", control, write=[1])[0] == 0
    assert mbpoll(1, "0", enable, write=[1])[0] == 0
    assert mbpoll(1, "0", control, count=2)[:2] == (0, [1, 1])
    assert mbpoll(1, "4:float", 0, write=[0.0])[0] == 0
    assert mbpoll(1, "0", control, write=[0])[0] == 0
    assert mbpoll(1, "0", control, count=2)[:2] == (0, [0, 0])


@pytest.mark.parametrize(
    ("kind", "address", "write", "words"),
    [
        ("3", 0, (), "Illegal data address"),
        ("3", 999, (), "Illegal data address"),
        ("4", 1, (0,), "Illegal data value"),
        ("4", 99, (1,), "Illegal data address"),
    ],
)
def test_it_is_refused_as_the_specification_says(mbpoll, kind, address, write, words):
    code, _, said = mbpoll(2, kind, address, write=write)
    assert code != 0
    assert words in said


def test_a_command_without_control_is_refused(mbpoll):
    code, _, said = mbpoll(1, "4:float", 0, write=[0.1])
    assert code != 0
    assert "Slave device or server failure" in said
