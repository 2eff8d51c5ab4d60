"""A kind of device: one object describes it completely to the bench."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Generic, TypeVar

from hil_bench.canopen_device.node import Node
from hil_bench.config.objects import ObjectValue
from hil_bench.config.settings import Key, Problems, Settings
from hil_bench.devices.axis import Fitting
from hil_bench.devices.kinds.bindings import (
    ScriptConfig,
    SinkConfig,
    SourceConfig,
    Surroundings,
    build_sinks,
)
from hil_bench.plants.plant import AxisSettings, Page


@dataclass(frozen=True, slots=True)
class NodeConfig:
    """The settings common to all CANopen nodes.

    Attributes:
        name: the node, as in ``[nodes.NAME]``.
        kind: of device.
        axis: the name of the axis that it belongs to; None where it belongs to none.
        node_id: CANopen node-ID, 1 to 127; 255 for a node that waits for LSS to give it one.
        bus: the name of the bus that it is on.
        eds: its EDS file.
        storage: folder of the file that it stores its parameters in; None for memory.
        serial_number: 0x1018.04; None for that of the EDS file, or where that has none for one that
            is made of the node's name.
        objects: other power-on values than those of the EDS file, by index and sub-index.
        sources: the objects that show quantities of the plant.
        scripts: the objects that follow a script.
        protected_tpdos: the TPDOs that have a counter and a checksum.
        added: what abilities' keys of its table say, by the attributes that these fill.
        place: how messages name its table.
    """

    name: str
    kind: "DeviceKind[Any]"
    axis: str | None
    node_id: int
    bus: str
    eds: Path
    storage: Path | None
    serial_number: int | None
    objects: Mapping[tuple[int, int], ObjectValue]
    sources: tuple[SourceConfig, ...]
    scripts: tuple[ScriptConfig, ...]
    protected_tpdos: tuple[int, ...]
    added: Mapping[str, object]
    place: str = field(compare=False)

    @property
    def profile(self) -> str:
        """The name of its device profile."""
        return self.kind.name

    @property
    def bindings(self) -> tuple[SourceConfig | SinkConfig, ...]:
        """All objects that are bound to the plant."""
        return self.sources


ConfigT = TypeVar("ConfigT", bound=NodeConfig)


class DeviceKind(ABC, Generic[ConfigT]):
    """A kind of device.

    Attributes:
        name: as in ``profile = "NAME"`` of ``[nodes.NODE]``.
        record: what its table becomes; each of `keys` fills an attribute of it, and its chain
            `chain`.
        eds: its EDS file; None where each node must name its own.
        keys: of its table, beside those of every node.
        registers: its Modbus register map; None where each unit must name its own.
        has_axis: whether it belongs to an axis.
        is_drive: whether it commands its axis, and may be commanded by Modbus.
        has_enable_input: whether such a device has an input that a fault may switch off.
        chain_unit: SI unit of what its measuring chain carries; None where it has none.
        driver: the class of its driver, as in ``drivers:PressureSensor``; None where it has none.
    """

    name: str
    record: type[ConfigT]
    eds: Path | None = None
    keys: tuple[Key, ...] = ()
    registers: Path | None = None
    has_axis: bool = True
    is_drive: bool = False
    has_enable_input: bool = False
    chain_unit: str | None = None
    driver: str | None = None

    @abstractmethod
    def fit(self, config: ConfigT, node: Node, surroundings: Surroundings) -> Fitting:
        """Build the device on its node, and return what it does on the bench."""

    def check(self, table: str, node: Settings, axis: AxisSettings, problems: Problems) -> None:
        """Note what of a node does not go with the plant of its axis."""

    def resolve(self, node: Settings, axis: AxisSettings) -> None:
        """Fill in what a node takes from its axis."""

    def measured(self, config: ConfigT) -> str | None:
        """Return the name of the plant's quantity that it measures."""
        return None

    def watched(self, config: ConfigT) -> Mapping[str, str]:
        """Return the quantities that its TPDOs tell, each with the attribute of its driver."""
        return MappingProxyType({})

    def full_scales(self, config: ConfigT) -> Mapping[str, float]:
        """Return the command of 100 % [SI] of each axis that it commands."""
        return MappingProxyType({})

    def page(self, config: ConfigT) -> Page | None:
        """Return the look of a node on the web page; None for its states and objects alone."""
        return None

    def signals(self, name: str, node: Settings) -> Mapping[str, str]:
        """Return the signals of a node that accept a sensor's faults, with their SI units."""
        return {} if self.chain_unit is None else {name: self.chain_unit}


def require_quantities(
    place: str, names: tuple[str, ...], axis: AxisSettings, problems: Problems
) -> None:
    """Note a quantity that the plant of a node's axis has not."""
    for name in names:
        if name not in axis.kind.by_name:
            right = "give the node another profile or another axis"
            problems.add(place, f"the plant is a {axis.kind.name} and has no {name}; {right}")
            return


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
