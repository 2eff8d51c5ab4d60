"""The drivers of a bench's devices, each set up when a test first asks for it."""

import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from operator import methodcaller
from pkgutil import resolve_name
from typing import NoReturn

import pytest

from hil_bench.bench.configuration import BenchConfig, NodeConfig
from hil_bench.errors import HilBenchError, WaitTimeoutError
from hil_drivers import PositionSensor, PressureSensor, ProportionalValve
from hil_drivers.errors import DriverError
from hil_drivers.network import HEARTBEAT_PERIOD, Network

# The drivers' networks of a bench with several buses, pumped together.


class Networks:
    """A network for each bus: that of the first is there, the others are made when asked for.

    Args:
        name: of the first bus.
        first: its network.
        make: makes the network of the bus of a name.
        period: longest time in which one network waits while the others do not look [s].
    """

    def __init__(
        self, name: str, first: Network, make: Callable[[str], Network], period: float
    ) -> None:
        self._networks = {name: first}
        self._make = make
        self._period = period

    def on(self, bus: str) -> Network:
        """Return the network of a bus."""
        if bus not in self._networks:
            self._networks[bus] = self._make(bus)
        return self._networks[bus]

    def pump(self, duration: float) -> None:
        """Let time pass, and take what arrives on any bus [s]."""
        first, *others = self._networks.values()
        end = first.now() + duration
        while others and end - first.now() > self._period:
            first.pump(self._period)
            for network in others:
                network.pump(0.0)
        first.pump_until(end)
        for network in others:
            network.pump(0.0)


EVENT_TIMER = 0.005
"""Time after which each device sends its values again [s]."""

Driver = PositionSensor | PressureSensor | ProportionalValve
"""A driver that a test can have, or one of the same methods that a kind of device brings."""


class Devices:
    """The drivers of the nodes of a bench, by the nodes' names.

    Args:
        config: the bench.
        networks: of its buses.
        stack: closes the drivers that need it.
    """

    def __init__(self, config: BenchConfig, networks: Networks, stack: ExitStack) -> None:
        self._nodes = {node.name: node for node in config.nodes}
        self._networks = networks
        self._event_timer = max(EVENT_TIMER, config.tick_ns * 1e-9)  # none is finer than a tick
        self._stack = stack
        self._drivers: dict[str, Driver] = {}

    def __call__(self, name: str) -> Driver:
        """Return the driver of a node, set up, OPERATIONAL and with its first values.

        A valve waits for `enable`, and is disabled at the end of the test.
        """
        if name not in self._nodes:
            pytest.fail(f"device({name!r}): the bench has {', '.join(self._nodes)}")
        if name not in self._drivers:
            self._drivers[name] = self._bind(self._nodes[name])
        return self._drivers[name]

    def _bind(self, node: NodeConfig) -> Driver:
        if node.kind.driver is None:
            pytest.fail(f"device({node.name!r}): there is no driver for {node.profile}")
        network = self._networks.on(node.bus)
        driver: Driver = resolve_name(node.kind.driver)(network, node.node_id, node.eds)
        if isinstance(driver, ProportionalValve):
            self._stack.enter_context(driver)
            driver.setup(
                transmission_type=254,
                event_timer=self._event_timer,
                command_timeout=0.0,
                heartbeat_timeout=4 * HEARTBEAT_PERIOD,
            )
        else:
            driver.setup(transmission_type=254, event_timer=self._event_timer)
        _start(network, driver, node.node_id)
        return driver


def hide_drivers_from_tracebacks() -> None:
    """Let pytest show the test's own line for an error that says what a device did."""
    for name, module in list(sys.modules.items()):
        if name.partition(".")[0] in {
            "hil_drivers",
            "contextlib",
        }:  # they raise in with blocks, too
            vars(module)["__tracebackhide__"] = methodcaller("errisinstance", DriverError)


def _start(network: Network, driver: Driver, node_id: int) -> None:
    """Bring a device to OPERATIONAL and wait for its first values."""
    network.start_node(node_id)
    network.wait_until(lambda: driver.age < 1.0, 1.0, f"{driver.node}: first values")


# The `bench` of a test on a physical bus: time passes, and nothing can be looked into.

# Of an error that says what a test's controller did wrong, pytest shows the test's own line.
__tracebackhide__ = methodcaller("errisinstance", HilBenchError)

LOOK = 0.001
"""Time between two looks at a condition [s]."""


class PhysicalBench:
    """The part of a `VirtualBench` that hardware has too: its time; anything else skips the test.

    Args:
        config: the bench's configuration.

    Attributes:
        config: as passed in.
        pump: takes what arrives on the bus for some seconds; drivers put their network's here.
    """

    def __init__(self, config: BenchConfig) -> None:
        self.config = config
        self.pump: Callable[[float], None] = time.sleep
        self._start = time.monotonic()

    def now(self) -> float:
        """Return the time since the test began [s]."""
        return time.monotonic() - self._start

    def run(self, duration: float) -> None:
        """Let time pass [s]."""
        self.pump(duration)

    def run_until(self, condition: Callable[[], bool], *, timeout: float) -> float:
        """Let time pass until a condition holds; see `VirtualBench.run_until`.

        Raises:
            WaitTimeoutError: it did not hold in time.
        """
        start = self.now()
        while not condition():
            if self.now() - start >= timeout:
                raise WaitTimeoutError(f"condition not met within {timeout:g} s")
            self.pump(LOOK)
        return self.now() - start

    def __getattr__(self, name: str) -> NoReturn:
        pytest.skip(f"bench.{name} needs the virtual bench, which --hil-interface turns off")
