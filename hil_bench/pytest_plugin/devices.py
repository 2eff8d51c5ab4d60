"""The drivers of a bench's devices, each set up when a test first asks for it."""

import sys
from contextlib import ExitStack
from operator import methodcaller
from pkgutil import resolve_name

import pytest

from hil_bench.bench.configuration import BenchConfig, NodeConfig
from hil_bench.pytest_plugin.networks import Networks
from hil_drivers import PositionSensor, PressureSensor, ProportionalValve
from hil_drivers.errors import DriverError
from hil_drivers.network import HEARTBEAT_PERIOD, Network

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
