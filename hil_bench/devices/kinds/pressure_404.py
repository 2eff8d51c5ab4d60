"""The kinds of pressure transducers by CiA 404."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from device_profiles import PRESSURE_404, REGISTERS, TRANSDUCER_404
from hil_bench.canopen_device.node import Node
from hil_bench.config.settings import Key, Problems, Settings
from hil_bench.config.values import describe, interval, number, text
from hil_bench.devices.axis import Fitting, Measurement
from hil_bench.devices.kinds.bindings import Surroundings
from hil_bench.devices.kinds.kind import DeviceKind, NodeConfig
from hil_bench.devices.measurement.low_pass import ChainParameters
from hil_bench.devices.pressure_404 import TEMPERATURE_UNITS, PressureDevice, Span, TransducerDevice
from hil_bench.plants.hydraulic_cylinder.quantities import T_OIL
from hil_bench.plants.plant import AxisSettings
from hil_bench.plants.registry import DEFAULT_PLANT
from hil_bench.units import BAR, CELSIUS

# The pressure transducer of CiA 404 as a kind of device.

_UNIT = "Pa"


@dataclass(frozen=True, slots=True)
class PressureConfig(NodeConfig):
    """A pressure transducer (CiA 404).

    Attributes:
        source: the pressure that it measures.
        span: measuring range, start and end [Pa].
        chain: what lies between the pressure and the transducer's objects.
    """

    source: str
    span: tuple[float, float]
    chain: ChainParameters


class PressureKind(DeviceKind[PressureConfig]):
    """A transducer measures one pressure of its axis."""

    name = "pressure_404"
    record = PressureConfig
    eds = PRESSURE_404
    keys = (
        Key("source", text, example=f'"{DEFAULT_PLANT.outputs_in(_UNIT)[0].name}"'),
        Key("span_bar", interval(BAR), (0.0, 250.0), BAR, "span"),
    )
    registers = REGISTERS / "pressure_404.toml"
    chain_unit = _UNIT
    driver = "hil_drivers:PressureSensor"

    def check(self, table: str, node: Settings, axis: AxisSettings, problems: Problems) -> None:
        """Note a source that is no pressure of the plant."""
        check_pressure(table, "source", node, axis, problems)

    def measured(self, config: PressureConfig) -> str:
        """Return the pressure that it measures."""
        return config.source

    def watched(self, config: PressureConfig) -> Mapping[str, str]:
        """Return that pressure."""
        return {config.source: "pressure"}

    def fit(self, config: PressureConfig, node: Node, surroundings: Surroundings) -> Fitting:
        """Build the transducer, behind its chain if any."""
        chain = surroundings.chain(config.chain, config.name)
        device = PressureDevice(node, config.span)
        quantity = surroundings.axes[str(config.axis)].kind.by_name[config.source]
        stages = () if chain is None else (chain.measure,)
        measurement = Measurement(device.publish, quantity, stages, name=config.name)
        return Fitting(sensors=((str(config.axis), measurement),))


def check_pressure(
    table: str, key: str, node: Settings, axis: AxisSettings, problems: Problems
) -> None:
    """Note a key that names no pressure of the plant."""
    if key not in node:
        return  # it is missing, which is noted already
    source = node[key].value
    known = [quantity.name for quantity in axis.kind.outputs_in(_UNIT)]
    if source not in known:
        names = ", ".join(f'"{name}"' for name in known)
        right = f"give one of {names}" if names else f"a {axis.kind.name} has no pressure"
        problems.add(problems.place(table, key), f"{describe(source)} is unknown; {right}")


PRESSURE: Final = PressureKind()


# A transducer of CiA 404 with two pressures and a temperature as a kind of device.

_SOURCES = ("source", "second_source")


@dataclass(frozen=True, slots=True)
class TransducerConfig(NodeConfig):
    """A transducer of two pressures and a temperature (CiA 404).

    Attributes:
        source: the pressure that channel 1 measures.
        second_source: the pressure that channel 2 measures.
        span: measuring range of both, start and end [Pa].
        temperature: of the oil at the transducer, which channel 3 measures [°C]; that of the
            supply's oil takes its place where there is one.
        temperature_span: its measuring range [°C].
        chain: what lies between each pressure and its objects.
    """

    source: str
    second_source: str
    span: tuple[float, float]
    temperature: float
    temperature_span: tuple[float, float]
    chain: ChainParameters


class TransducerKind(DeviceKind[TransducerConfig]):
    """A transducer measures two pressures of its axis, and the temperature of the oil."""

    name = "transducer_404"
    record = TransducerConfig
    eds = TRANSDUCER_404
    registers = REGISTERS / "transducer_404.toml"
    keys = (
        Key("source", text, "P_A"),
        Key("second_source", text, "P_B"),
        Key("span_bar", interval(BAR), (0.0, 250.0), BAR, "span"),
        Key(
            "temperature_c", number(CELSIUS, low=-273.15, high=1000.0), 40.0, CELSIUS, "temperature"
        ),
        Key("temperature_span_c", interval(CELSIUS), (-40.0, 125.0), CELSIUS, "temperature_span"),
    )
    chain_unit = _UNIT
    driver = "hil_drivers:PressureSensor"

    def check(self, table: str, node: Settings, axis: AxisSettings, problems: Problems) -> None:
        """Note a source that is no pressure of the plant."""
        for key in _SOURCES:
            check_pressure(table, key, node, axis, problems)

    def measured(self, config: TransducerConfig) -> str:
        """Return the pressure that channel 1 measures."""
        return config.source

    def watched(self, config: TransducerConfig) -> Mapping[str, str]:
        """Return that pressure."""
        return {config.source: "pressure"}

    def signals(self, name: str, node: Settings) -> Mapping[str, str]:
        """Return both pressures."""
        return {name: _UNIT, f"{name}.2": _UNIT}

    def fit(self, config: TransducerConfig, node: Node, surroundings: Surroundings) -> Fitting:
        """Build the transducer, each pressure behind a chain of its own if any."""
        pressures = Span(*config.span)
        temperatures = Span(*config.temperature_span, TEMPERATURE_UNITS)
        device = TransducerDevice(node, (pressures, pressures, temperatures))
        by_name = surroundings.axes[str(config.axis)].kind.by_name
        sensors = []
        for channel, source in ((1, config.source), (2, config.second_source)):
            name = config.name if channel == 1 else f"{config.name}.{channel}"
            chain = surroundings.chain(config.chain, name)
            stages = () if chain is None else (chain.measure,)

            def publish(pressure: float, _now: int, channel: int = channel) -> None:
                device.publish(channel, pressure)

            measurement = Measurement(publish, by_name[source], stages, name=name)
            sensors.append((str(config.axis), measurement))
        advance: Callable[[int], None] | None = None
        if T_OIL in by_name:

            def show(temperature: float, _now: int) -> None:
                device.publish(3, temperature)

            oil = Measurement(show, by_name[T_OIL], name=f"{config.name}.3")
            sensors.append((str(config.axis), oil))
        else:

            def advance(_now: int) -> None:
                device.publish(3, config.temperature)

        return Fitting(sensors=tuple(sensors), advance=advance)


TRANSDUCER: Final = TransducerKind()
