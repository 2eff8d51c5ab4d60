"""The benches that the drivers' suite runs against: one a kind of bus."""

import contextlib
import re
import signal
import socket
import subprocess
import sys
import time
from typing import NamedTuple

import can
import pytest
from support.any_bus import EMBEDDED, PROCESSES, embedded_rig, process_rig, vcan_rig
from support.patience import GUARD

from hil_bench.bench.assembly import build_bench
from hil_bench.bench.configuration import load_config
from hil_bench.outside.transports.embedded import EmbeddedBus
from hil_drivers import (
    ModbusExceptionError,
    Network,
    PositionSensor,
    PressureSensor,
    ProportionalValve,
)
from hil_drivers.modbus import ModbusClient, TcpLink

MODBUS_UNITS = """
[modbus.units.valve]
commands = true
[modbus.units.pressure_a]
[modbus.units.pressure_b]
[modbus.units.position]
[modbus.units.swapped]
node = "pressure_a"
unit_id = 12
word_order = "little"
"""


class Rig(NamedTuple):
    """The drivers of the built-in bench's devices, none of them set up."""

    network: Network
    valve: ProportionalValve
    pressure_a: PressureSensor
    pressure_b: PressureSensor
    position: PositionSensor

    @property
    def devices(self):
        return self.valve, self.pressure_a, self.pressure_b, self.position


@contextlib.contextmanager
def embedded_bus():
    """A bench in this process, in virtual time."""
    bench = build_bench(load_config())
    with EmbeddedBus(bench.tick) as bus:
        bench.start(0)
        yield bus, bus.now


@contextlib.contextmanager
def python_can_bus(**settings):
    """A bus to a bench in another process, in real time."""
    with can.Bus(**settings) as bus:
        yield bus, time.monotonic


@contextlib.contextmanager
def bench_process(*arguments):
    """A bench in a process of its own, once it is on its bus; gives what it printed till then."""
    command = [sys.executable, "-m", "hil_bench", "run", *arguments]
    with subprocess.Popen(  # noqa: S603 - our own program
        command, stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            # The device table is printed once the bus is open.
            printed = [next(process.stdout)]
            while not printed[-1].startswith("node 4"):
                printed.append(next(process.stdout))
            yield printed
        finally:
            process.send_signal(signal.SIGTERM)


class Endpoints(NamedTuple):
    """Where a bench in another process is found."""

    hub_port: int
    modbus_port: int
    serial_port: str


@pytest.fixture(scope="module")  # no longer: it takes a tenth of a processor while it is there
def bench_endpoints(tmp_path_factory):
    """A bench that hosts a hub, and is on Modbus TCP and RTU too."""
    path = tmp_path_factory.mktemp("bench") / "bench.toml"
    path.write_text(f'[modbus]\nport = 0\nserial_port = "pty"\n{MODBUS_UNITS}')
    with bench_process(str(path), "--hub", "0") as printed:
        text = "".join(printed)
        endpoints = Endpoints(
            int(re.search(r"port=(\d+)", text)[1]),
            int(re.search(r"modbus TCP .*:(\d+)", text)[1]),
            re.search(r"modbus RTU (\S+)", text)[1],
        )
        await_values(endpoints.modbus_port)
        yield endpoints


def await_values(port):
    """Wait until the loop has begun: before that there are no values."""
    with ModbusClient(TcpLink("127.0.0.1", port), timeout=GUARD) as client:
        while True:
            with contextlib.suppress(ModbusExceptionError):
                client.read_registers(2, "input_registers", 0, 2)
                return


@pytest.fixture(scope="module")
def hub_port(bench_endpoints):
    """A bench that hosts a hub."""
    return bench_endpoints.hub_port


@pytest.fixture(scope="module")
def vcan_bench():
    """A bench on vcan0."""
    with bench_process("-i", "socketcan", "-c", "vcan0"):
        yield


def has_vcan():
    try:
        with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as can_socket:
            can_socket.bind(("vcan0",))
    except (AttributeError, OSError):
        return False
    return True


@pytest.fixture(
    params=[
        "embedded",
        pytest.param("socketcand", marks=pytest.mark.long),
        *([pytest.param("socketcan", marks=pytest.mark.long)] if has_vcan() else []),
    ]
)
def connect(request):
    """Opens a bus with the built-in bench on it; gives the bus and its clock."""
    if request.param == "embedded":
        return embedded_bus()
    if request.param == "socketcan":
        request.getfixturevalue("vcan_bench")
        return python_can_bus(interface="socketcan", channel="vcan0")
    port = request.getfixturevalue("hub_port")
    return python_can_bus(interface="socketcand", channel="can0", host="127.0.0.1", port=port)


@pytest.fixture
def rig(connect):
    """The drivers of the built-in bench, its nodes just booted."""
    with connect as (bus, clock):
        network = Network(bus, clock=clock)
        rig = Rig(
            network,
            ProportionalValve(network, 1, max_age=GUARD),
            PressureSensor(network, 2, max_age=GUARD),
            PressureSensor(network, 3, max_age=GUARD),
            PositionSensor(network, 4, max_age=GUARD),
        )
        for device in rig.devices:
            device.node.read_device_type()  # powered on, whatever its past
            network.reset_node(device.node.node_id, timeout=GUARD)
            device.node.emergencies.clear()
        yield rig


@pytest.fixture
def started(rig):
    """The same, set up to answer SYNC, watching nothing, and OPERATIONAL."""
    for sensor in (rig.pressure_a, rig.pressure_b, rig.position):
        sensor.setup()
    rig.valve.setup(command_timeout=0.0)
    rig.network.start_node()
    return rig


REAL_TIME = [*PROCESSES, *([pytest.param("vcan", marks=pytest.mark.long)] if has_vcan() else [])]


@pytest.fixture(params=[*EMBEDDED, *REAL_TIME])
def any_rig(request, tmp_path):
    """The drivers of the built-in bench, over every combination of buses; none is set up."""
    with open_rig(request, tmp_path) as opened:
        yield opened


@pytest.fixture(params=EMBEDDED)
def near_rig(request, tmp_path):
    """The same, where the bench is in this process and time is virtual."""
    with open_rig(request, tmp_path) as opened:
        yield opened


@pytest.fixture(params=REAL_TIME)
def far_rig(request, tmp_path):
    """The same, where the bench is in another process and time is the machine's."""
    with open_rig(request, tmp_path) as opened:
        yield opened


def open_rig(request, tmp_path):
    place, _, kind = request.param.partition("-")
    if place == "embedded":
        path = tmp_path / "bench.toml"
        path.write_text(MODBUS_UNITS)
        return embedded_rig(kind, path)
    if place == "vcan":
        request.getfixturevalue("vcan_bench")
        return vcan_rig(time.monotonic)
    return process_rig(kind, request.getfixturevalue("bench_endpoints"), time.monotonic)
