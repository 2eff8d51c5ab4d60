"""A device made from its EDS file alone as a kind of device."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from hil_bench.canopen_device.node import Node
from hil_bench.devices.axis import Fitting
from hil_bench.devices.kinds.bindings import SinkConfig, SourceConfig, build_sinks
from hil_bench.devices.kinds.kind import DeviceKind, NodeConfig
from hil_bench.devices.kinds.surroundings import Surroundings


@dataclass(frozen=True, slots=True)
class GenericConfig(NodeConfig):
    """A device made from its EDS file alone.

    Attributes:
        sinks: the objects that command the plant.
    """

    sinks: tuple[SinkConfig, ...]

    @property
    def bindings(self) -> tuple[SourceConfig | SinkConfig, ...]:
        """All objects that are bound to the plant."""
        return (*self.sources, *self.sinks)


class GenericKind(DeviceKind[GenericConfig]):
    """Such a device does nothing of its own; its objects may be bound to axes."""

    name = "generic"
    record = GenericConfig
    has_axis = False

    def full_scales(self, config: GenericConfig) -> Mapping[str, float]:
        """Return the full scale of each axis that an object commands."""
        return {sink.axis: sink.full_opening for sink in config.sinks}

    def fit(self, config: GenericConfig, node: Node, surroundings: Surroundings) -> Fitting:
        """Return the objects that command axes."""
        return Fitting(drives=tuple(build_sinks(config.name, config.sinks, node)))


GENERIC: Final = GenericKind()
