"""The nodes of the axis that is commissioned."""

from collections.abc import Callable
from typing import Any, NamedTuple

from hil_bench.config import (
    BenchConfig,
    EncoderConfig,
    NodeConfig,
    PressureConfig,
    PressureSource,
    ValveConfig,
)
from hil_bench.errors import ConfigError


class Members(NamedTuple):
    """The nodes of an axis."""

    valve: ValveConfig
    position: EncoderConfig
    pressure_a: PressureConfig
    pressure_b: PressureConfig


def find_members(config: BenchConfig, axis: str) -> Members:
    """Return the nodes of an axis: valve, position sensor, pressure transducers at A and B."""
    nodes = [node for node in config.nodes if node.axis == axis]

    def find(what: str, wanted: Callable[[NodeConfig], bool]) -> Any:  # noqa: ANN401 - of its type
        for node in nodes:
            if wanted(node):
                return node
        raise ConfigError(f"plant.{axis}: no node is its {what}; commissioning needs one")

    return Members(
        find("valve_408", lambda node: isinstance(node, ValveConfig)),
        find("encoder_406", lambda node: isinstance(node, EncoderConfig)),
        *(
            find(
                f"pressure_404 at {source}",
                lambda node, source=source: getattr(node, "source", None) is source,  # type: ignore[misc]
            )
            for source in PressureSource
        ),
    )
