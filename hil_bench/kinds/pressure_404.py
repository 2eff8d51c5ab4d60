"""The pressure transducer of CiA 404 as a kind of device."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final

from device_profiles import PRESSURE_404, REGISTERS
from hil_bench.canopen_device.node import Node
from hil_bench.config.settings import Key, Problems, Settings
from hil_bench.config.values import describe, interval, text
from hil_bench.devices.axis import Fitting, Measurement
from hil_bench.devices.measurement.parameters import ChainParameters
from hil_bench.devices.pressure_404 import PressureDevice
from hil_bench.devices.quantities import pressure_quantities
from hil_bench.kinds.kind import DeviceKind, NodeConfig
from hil_bench.kinds.surroundings import Surroundings
from hil_bench.plants.kind import AxisSettings
from hil_bench.plants.registry import DEFAULT_PLANT
from hil_bench.units import BAR

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
        return Fitting(
            sensors=((str(config.axis), measurement),),
            registers=partial(pressure_quantities, node.object_dictionary),
        )


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
