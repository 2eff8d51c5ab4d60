"""The work of a controller of the kind `fmu`: devices to FMU to devices, once a cycle."""

import math
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pkgutil import resolve_name
from typing import Any, Final

from hil_bench.abilities.controllers.fmu.plan import Plan
from hil_bench.abilities.controllers.python.controller import Rig
from hil_bench.abilities.controllers.seam import Surroundings
from hil_bench.bench.configuration import BenchConfig, NodeConfig
from hil_bench.config.values import find_nearest, quote
from hil_bench.errors import ConfigError, ControllerError
from hil_bench.plants.fmu.child import Child
from hil_bench.plants.fmu.configuration import Bound
from hil_bench.plants.fmu.description import unpack
from hil_bench.plants.fmu.slave import Setup, SlaveError
from hil_drivers import Network, ProportionalValve
from hil_drivers.device import Device

COMMAND: Final = "spool_setpoint"
"""The quantity that a valve's driver commands."""

_SPEED: Final = "speed"
_COMMAND_TIMEOUT, _HEARTBEAT_TIMEOUT = 0.1, 0.2  # [s]


@dataclass(frozen=True, slots=True)
class Place:
    """A quantity of the machine as a driver has it.

    Attributes:
        node: of the device.
        attribute: of its driver, in SI.
        unit: SI unit.
    """

    node: NodeConfig
    attribute: str
    unit: str


def places_of(config: BenchConfig, buses: Sequence[str]) -> dict[str, Place]:
    """Return the quantities that the drivers of a bench read and command, by ``AXIS.QUANTITY``.

    Where two devices measure one quantity, the first of the file does.

    Args:
        config: the bench.
        buses: names of the buses whose devices count.
    """
    axes = {axis.name: axis for axis in config.axes}
    places: dict[str, Place] = {}
    for node in config.nodes:
        if node.axis not in axes or node.bus not in buses or node.kind.driver is None:
            continue
        driver = resolve_name(node.kind.driver)
        read = dict(node.kind.watched(node))
        if hasattr(driver, _SPEED):
            read[_SPEED] = _SPEED
        if issubclass(driver, ProportionalValve):
            read[COMMAND] = COMMAND
        by_name = axes[node.axis].kind.by_name
        for quantity, attribute in read.items():
            place = Place(node, attribute, by_name[quantity].unit)
            places.setdefault(f"{node.axis}.{quantity}", place)
    return places


class FmuControl:
    """A callable for `PythonController`: drives the devices that an FMU's variables are bound to.

    Args:
        plan: the FMU and what is bound of it.
        surroundings: where it lives.

    Raises:
        ConfigError: the bench has no such quantity, or one is of another unit.
    """

    def __init__(self, plan: Plan, surroundings: Surroundings) -> None:
        self._plan, self._surroundings = plan, surroundings
        tick_ns = surroundings.tick_ns
        if round(plan.period * 1e9) % tick_ns:
            wrong = f"{plan.period * 1e3:g} ms is no multiple of the tick"
            raise self._wrong("period_ms", f"{wrong}; give a multiple of {tick_ns / 1e6:g}")
        self._places = places_of(surroundings.config, surroundings.buses)
        commands = {name: each for name, each in self._places.items() if each.attribute == COMMAND}
        for name, bound in plan.outputs.items():
            self._check("outputs", name, bound, commands)
        for name, bound in plan.inputs.items():
            if "." in name:
                self._check("inputs", name, bound, self._places)
            elif name not in surroundings.values:
                known = [*surroundings.values, *self._places]
                near = f"the nearest is {find_nearest(name, known)}" if known else "there is none"
                raise self._wrong("inputs", f"{quote(name)} is no parameter; {near}")
        self._nodes = {
            place.node.name: place.node
            for place in map(self._places.get, (*plan.inputs, *plan.outputs))
            if place is not None
        }
        buses = sorted({node.bus for node in self._nodes.values()})
        if len(buses) > 1:
            wrong = f"its quantities are on the buses {' and '.join(buses)}"
            raise self._wrong("buses", f"{wrong}; devices of one bus are right")
        self._bus = buses[0]

    def __call__(self, rig: Rig) -> Generator[None]:
        """Set the devices up, and let the FMU work from cycle to cycle.

        A device that has failed is a `DriverError`, an FMU that has failed a `ControllerError`.

        Yields:
            After each cycle.
        """
        with ExitStack() as stack:
            fmu = self._start()
            stack.callback(fmu.end)
            network = stack.enter_context(rig.network(self._bus))
            devices = self._set_up(network, stack)
            valves = [each for each in devices.values() if isinstance(each, ProportionalValve)]
            _sample(network, devices.values(), 1.0)
            for valve in valves:
                valve.reset_fault()  # that of a controller before
                valve.enable()
            read = self._readers(devices)
            due = network.now()
            while True:
                _sample(network, devices.values(), self._plan.period)
                for valve in valves:
                    valve.check_active()
                self._command(devices, self._step(fmu, [each() for each in read], rig.now()))
                yield
                due += self._plan.period
                network.pump_until(due)

    def _check(self, key: str, name: str, bound: Bound, known: Mapping[str, Place]) -> None:
        """Refuse a quantity that is not there, or a variable of another dimension."""
        place = known.get(name)
        if place is None:
            near = f"the nearest is {find_nearest(name, known)}" if known else "it has none"
            what = "measure" if key == "inputs" else "take"
            wrong = f"{quote(name)} is no quantity that the devices of the bench {what}"
            raise self._wrong(key, f"{wrong}; {near}")
        if bound.unit not in {place.unit, "-"}:
            wrong = f"{name} is in {place.unit}, and its variable in {bound.unit}"
            raise self._wrong(key, f"{wrong}; bind one of the same dimension")

    def _wrong(self, key: str, what: str) -> ConfigError:
        return ConfigError(f"{self._surroundings.place}.{key}: {what}")

    def _start(self) -> Child:
        """Start the FMU in a process of its own.

        Raises:
            ControllerError: it cannot be started.
        """
        plan, folder = self._plan, self._surroundings.scratch / "fmu"
        unpack(plan.path, folder)
        filled = self._surroundings.filled
        variables = [bound.variable for bound in plan.inputs.values()]
        try:
            return Child(
                Setup(
                    version=plan.description.version,
                    token=plan.description.token,
                    identifier=plan.description.identifier,
                    folder=str(folder),
                    library=str(folder / plan.description.library),
                    name=self._surroundings.name,
                    step=plan.period,
                    parameters=[
                        (reference, self._number(filled(word)))
                        for reference, word in plan.parameters
                    ],
                    written=[each.reference for each in variables],
                    given=[each.start or 0.0 for each in variables],
                    read=[bound.variable.reference for bound in plan.outputs.values()],
                )
            )
        except SlaveError as error:
            raise ControllerError(f"{plan.path}: {error}") from None

    def _number(self, word: str) -> float:
        """Return the number of a word.

        Raises:
            ControllerError: it stands for no parameter of the scenario.
        """
        try:
            return float(word)
        except ValueError:
            place = f"{self._surroundings.place}.parameters"
            raise ControllerError(f"{place}: {word} is no parameter of the scenario") from None

    def _set_up(self, network: Network, stack: ExitStack) -> dict[str, Device]:
        """Set the devices up and start their nodes; return their drivers by name of the node."""
        network.start_heartbeat()
        devices: dict[str, Device] = {}
        for name, node in self._nodes.items():
            driver: Any = resolve_name(str(node.kind.driver))(network, node.node_id, node.eds)
            devices[name] = driver
            if isinstance(driver, ProportionalValve):
                stack.enter_context(driver)
                driver.setup(command_timeout=_COMMAND_TIMEOUT, heartbeat_timeout=_HEARTBEAT_TIMEOUT)
            else:
                driver.setup()
            network.start_node(node.node_id)
        return devices

    def _readers(self, devices: Mapping[str, Device]) -> list[Callable[[], float]]:
        """Return a function that reads each input, in the unit of its variable."""
        readers: list[Callable[[], float]] = []
        for name, bound in self._plan.inputs.items():
            place = self._places.get(name)
            if place is None:
                value = self._surroundings.values[name]
                readers.append(lambda value=value: value)  # type: ignore[misc]
            else:
                readers.append(_reader(devices[place.node.name], place.attribute, bound.factor))
        return readers

    def _step(self, fmu: Child, given: list[float], now: float) -> tuple[float, ...]:
        """Let the FMU live for a cycle; return its outputs.

        Raises:
            ControllerError: it has failed, or an output is no number.
        """
        place = f"{self._plan.path}: at {now:.4g} s"
        try:
            values = fmu.go_on(given, 1)
        except SlaveError as error:
            raise ControllerError(f"{place}: {error}") from None
        for name, value in zip(self._plan.outputs, values, strict=True):
            if not math.isfinite(value):
                raise ControllerError(f"{place}: {name} is {value}; a finite number is right")
        return values

    def _command(self, devices: Mapping[str, Device], values: Sequence[float]) -> None:
        """Give the valves their set-points, within what they take."""
        for (name, bound), value in zip(self._plan.outputs.items(), values, strict=True):
            place = self._places[name]
            fraction = min(max(value * bound.factor, -1.0), 1.0)
            setattr(devices[place.node.name], place.attribute, fraction)


def _reader(device: Device, attribute: str, factor: float) -> Callable[[], float]:
    return lambda: float(getattr(device, attribute)) / factor


def _sample(network: Network, devices: Any, timeout: float) -> None:  # noqa: ANN401 - a view
    """Send SYNC, and wait for the answers of all devices; those that do not come grow old."""
    since = network.now()
    network.sync()
    network.wait_for(lambda: all(each.received_at > since for each in devices), timeout)
