"""Rigs of the built-in bench's devices, whatever bus each device is on."""

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import can
import pytest
from support.patience import GUARD

from hil_bench import VirtualBench, load_config
from hil_drivers import Network, PositionSensor, PressureSensor, ProportionalValve, modbus
from hil_drivers.interfaces import CommandedValve, Medium, PositionSource, PressureSource
from hil_drivers.modbus.framing import RtuFraming, TcpFraming
from hil_drivers.modbus.links import Link

VALVE, PRESSURE_A, PRESSURE_B, POSITION = 1, 2, 3, 4
"""Node-IDs, and unit-IDs, of the built-in bench."""


def nothing() -> None:
    """This rig cannot do that."""


@dataclass
class AnyRig:
    """The drivers of one axis, none of them set up.

    Attributes:
        network: the bus that paces a control loop.
        make: makes a sensor's driver, by the name of its class and its address.
        start: what a bus needs once its devices are set up.
        lose: has the pressure sensor at port A no longer be there.
        regain: takes that back.
    """

    network: Medium
    valve: CommandedValve
    make: Callable[[str, int], PressureSource | PositionSource]
    start: Callable[[], None] = nothing
    lose: Callable[[], None] = nothing
    regain: Callable[[], None] = nothing
    pressure_a: PressureSource = field(init=False)
    pressure_b: PressureSource = field(init=False)
    position: PositionSource = field(init=False)

    def __post_init__(self):
        self.pressure_a = self.make("PressureSensor", PRESSURE_A)
        self.pressure_b = self.make("PressureSensor", PRESSURE_B)
        self.position = self.make("PositionSensor", POSITION)

    @property
    def sensors(self):
        return self.pressure_a, self.pressure_b, self.position

    @property
    def devices(self):
        return (self.valve, *self.sensors)

    def set_up(self, *, command_timeout=0.0):
        for sensor in self.sensors:
            sensor.setup()
        self.valve.setup(command_timeout=command_timeout)
        self.start()

    def sample(self):
        """Has every device give its values."""
        since = self.network.now()
        self.network.sync()
        for device in self.devices:
            if not device.poll():
                assert self.network.wait_for(lambda d=device: d.received_at > since, GUARD), device

    def wait_until(self, condition):
        deadline = self.network.now() + GUARD
        while not condition():
            assert self.network.now() < deadline
            self.network.pump_until(self.network.now() + 0.005)

    def hold_still(self):
        """Waits until the piston has come to rest."""
        self.wait_until(lambda: self.sample() or self.position.speed == 0.0)


def maker(module, bus) -> Callable[[str, int], PressureSource | PositionSource]:
    return lambda name, address: getattr(module, name)(bus, address, max_age=GUARD)


class _CanopenDrivers:
    PressureSensor = PressureSensor
    PositionSensor = PositionSensor


@contextlib.contextmanager
def canopen_rig(bus: can.BusABC, clock: Callable[[], float]) -> Iterator[AnyRig]:
    with Network(bus, clock=clock) as network:
        rig = AnyRig(
            network,
            ProportionalValve(network, VALVE, max_age=GUARD),
            maker(_CanopenDrivers, network),
            start=network.start_node,
            lose=lambda: network.stop_node(PRESSURE_A),
            regain=lambda: network.start_node(PRESSURE_A),
        )
        reset_nodes(network, rig.devices)
        with rig.valve:
            yield rig


@contextlib.contextmanager
def modbus_rig(link: Link, **client_settings: object) -> Iterator[AnyRig]:
    with modbus.ModbusClient(link, **client_settings) as client:
        rig = AnyRig(
            client,
            modbus.ProportionalValve(client, VALVE, max_age=GUARD),
            maker(modbus, client),
            lose=lambda: setattr(link, "is_cut", True),
            regain=lambda: setattr(link, "is_cut", False),
        )
        with rig.valve:
            yield rig


@contextlib.contextmanager
def mixed_rig(
    bus: can.BusABC, clock: Callable[[], float], link: Link, timeout: float = 0.2
) -> Iterator[AnyRig]:
    """The valve on CANopen, the sensors on Modbus."""
    with (
        Network(bus, clock=clock) as network,
        modbus.ModbusClient(link, clock=clock, timeout=timeout) as client,
    ):
        valve = ProportionalValve(network, VALVE, max_age=GUARD)
        reset_nodes(network, [valve])
        rig = AnyRig(
            network,
            valve,
            maker(modbus, client),
            start=lambda: network.start_node(VALVE),
            lose=lambda: setattr(link, "is_cut", True),
            regain=lambda: setattr(link, "is_cut", False),
        )
        with valve:
            yield rig


def reset_nodes(network, devices):
    for device in devices:
        device.node.read_device_type()  # powered on, whatever its past
        network.reset_node(device.node.node_id, timeout=GUARD)
        device.node.emergencies.clear()


@contextlib.contextmanager
def embedded_rig(kind: str, path) -> Iterator[AnyRig]:
    """A rig whose bench is in this process, in virtual time."""
    with VirtualBench(load_config(path)) as bench:
        if kind != "canopen":
            bench.run(0.005)
        link = bench.modbus_link(
            RtuFraming() if kind == "rtu" else TcpFraming(), is_serial=kind == "rtu"
        )
        if kind == "canopen":
            rig = canopen_rig(bench.bus, bench.now)
        elif kind == "mixed":
            rig = mixed_rig(bench.bus, bench.now, link)
        else:
            rig = modbus_rig(link, clock=bench.now)
        with rig as entered:
            yield entered


def process_rig(kind: str, endpoints, clock) -> contextlib.AbstractContextManager[AnyRig]:
    """A rig whose bench is in another process, in real time."""
    tcp = modbus.TcpLink("127.0.0.1", endpoints.modbus_port)
    if kind == "tcp":
        return modbus_rig(tcp, timeout=GUARD)
    if kind == "rtu":
        return modbus_rig(modbus.SerialLink(endpoints.serial_port, parity="N"), timeout=GUARD)
    return _hub_rig(kind, endpoints.hub_port, clock, tcp)


@contextlib.contextmanager
def _hub_rig(kind, port, clock, tcp):
    settings = {"interface": "socketcand", "channel": "can0", "host": "127.0.0.1", "port": port}
    with can.Bus(**settings) as bus:
        rig = canopen_rig(bus, clock) if kind == "hub" else mixed_rig(bus, clock, tcp, GUARD)
        with rig as entered:
            yield entered


@contextlib.contextmanager
def vcan_rig(clock):
    with can.Bus(interface="socketcan", channel="vcan0") as bus, canopen_rig(bus, clock) as rig:
        yield rig


EMBEDDED = [f"embedded-{kind}" for kind in ("canopen", "tcp", "rtu", "mixed")]
PROCESSES = [
    pytest.param(f"process-{kind}", marks=pytest.mark.long)
    for kind in ("hub", "tcp", "rtu", "mixed")
]
