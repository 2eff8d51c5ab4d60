"""The nodes of a cylinder or a motor: which of them does what."""

from collections.abc import Callable
from typing import Any, NamedTuple

from hil_bench.bench.configuration import BenchConfig, NodeConfig
from hil_bench.devices.kinds.encoder_406 import ROTARY_ENCODER, EncoderConfig, RotaryEncoderConfig
from hil_bench.devices.kinds.pressure_404 import PressureConfig
from hil_bench.devices.kinds.registry import ENCODER, PRESSURE, VALVE
from hil_bench.devices.kinds.valve_408 import ValveConfig
from hil_bench.errors import ConfigError
from hil_bench.plants.hydraulic_cylinder.quantities import PORTS


class Members(NamedTuple):
    """The nodes of an axis."""

    valve: ValveConfig
    position: EncoderConfig | RotaryEncoderConfig
    pressure_a: PressureConfig
    pressure_b: PressureConfig


def find_members(config: BenchConfig, axis: str, who: str, *, turns: bool = False) -> Members:
    """Return the nodes of an axis: valve, position sensor, pressure transducers at A and B.

    Args:
        config: the bench.
        axis: name of the axis.
        who: needs them, for the message that says which is missing.
        turns: whether the axis is a motor, whose position sensor is a rotary one.
    """
    nodes = [node for node in config.nodes if node.axis == axis]

    def find(what: str, wanted: Callable[[NodeConfig], bool]) -> Any:  # noqa: ANN401 - of its type
        for node in nodes:
            if wanted(node):
                return node
        raise ConfigError(f"plant.{axis}: no node is its {what}; {who} needs one")

    encoder, record = (ROTARY_ENCODER, RotaryEncoderConfig) if turns else (ENCODER, EncoderConfig)
    return Members(
        find(VALVE.name, lambda node: isinstance(node, ValveConfig)),
        find(encoder.name, lambda node: isinstance(node, record)),
        *(
            find(
                f"{PRESSURE.name} at {port}",
                lambda node, port=port: node.kind.measured(node) == port,  # type: ignore[misc]
            )
            for port in PORTS
        ),
    )
