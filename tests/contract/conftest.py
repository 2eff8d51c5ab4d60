"""The benches that the drivers' suite runs against: one a kind of bus."""

import contextlib
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

import can
import pytest

from drivers import Network, PositionSensor, PressureSensor, ProportionalValve
from hil_bench.assembly import build_bench
from hil_bench.config import load_config
from hil_bench.transports.embedded import EmbeddedBus

WAIT = 10.0
"""Longest wait for what must come at once [s]."""

MAX_AGE = 5.0
"""Age limit of the drivers' values [s]: on a shared machine the other process may be held up."""


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
def embedded_bus() -> Iterator[tuple[can.BusABC, Callable[[], float]]]:
    """A bench in this process, in virtual time."""
    bench = build_bench(load_config())
    with EmbeddedBus(bench.tick) as bus:
        bench.start(0)
        yield bus, bus.now


@contextlib.contextmanager
def python_can_bus(**settings: object) -> Iterator[tuple[can.BusABC, Callable[[], float]]]:
    """A bus to a bench in another process, in real time."""
    with can.Bus(**settings) as bus:
        yield bus, time.monotonic


@contextlib.contextmanager
def bench_process(*arguments: str) -> Iterator[None]:
    """A bench in a process of its own, once it is on its bus."""
    command = [sys.executable, "-m", "hil_bench", "run", *arguments]
    with subprocess.Popen(  # noqa: S603 - our own program
        command, stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            # The device table is printed once the bus is open.
            next(line for line in process.stdout if line.startswith("node 4"))
            yield
        finally:
            process.send_signal(signal.SIGTERM)


@pytest.fixture(scope="session")
def hub_port() -> Iterator[int]:
    """A bench that hosts a hub."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with bench_process("--hub", str(port)):
        yield port


@pytest.fixture(scope="session")
def vcan_bench() -> Iterator[None]:
    """A bench on vcan0."""
    with bench_process("-i", "socketcan", "-c", "vcan0"):
        yield


def has_vcan() -> bool:
    try:
        with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as can_socket:
            can_socket.bind(("vcan0",))
    except (AttributeError, OSError):
        return False
    return True


@pytest.fixture(
    params=[
        "embedded",
        pytest.param("socketcand", marks=pytest.mark.slow),
        *([pytest.param("socketcan", marks=pytest.mark.slow)] if has_vcan() else []),
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
def rig(connect) -> Iterator[Rig]:
    """The drivers of the built-in bench, its nodes just booted."""
    with connect as (bus, clock):
        network = Network(bus, clock=clock)
        rig = Rig(
            network,
            ProportionalValve(network, 1, max_age=MAX_AGE),
            PressureSensor(network, 2, max_age=MAX_AGE),
            PressureSensor(network, 3, max_age=MAX_AGE),
            PositionSensor(network, 4, max_age=MAX_AGE),
        )
        for device in rig.devices:
            device.node.read_device_type()  # powered on, whatever its past
            network.reset_node(device.node.node_id, timeout=WAIT)
            device.node.emergencies.clear()
        yield rig


@pytest.fixture
def started(rig) -> Rig:
    """The same, set up to answer SYNC, watching nothing, and OPERATIONAL."""
    for sensor in (rig.pressure_a, rig.pressure_b, rig.position):
        sensor.setup()
    rig.valve.setup(command_timeout=0.0)
    rig.network.start_node()
    return rig
