"""Nodes whose EDS is known: those that a decoder knows beforehand, and what their traffic says."""

from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple

from hil_bench.abilities.common.shown_units import display_unit
from hil_bench.abilities.eyes.manager_objects import object_of
from hil_bench.abilities.eyes.pdos import Pdo, find_pdos
from hil_bench.abilities.eyes.values import Reader, Scale, decides_scale, number_in
from hil_bench.bench.configuration import BenchConfig, NodeConfig
from hil_bench.bench.configuration.nodes_section import warn_of_commissioning, warn_of_findings
from hil_bench.bench.power_on import load_objects
from hil_bench.canopen_device.datatypes import (
    UNSIGNED8,
    UNSIGNED16,
    UNSIGNED32,
    VISIBLE_STRING,
    DataType,
)
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.eds_document import Severity
from hil_bench.canopen_device.errors import SdoAbort
from hil_bench.canopen_device.frame import DISABLED, can_id
from hil_bench.canopen_device.nmt import UNCONFIGURED
from hil_bench.canopen_device.object_dictionary import ObjectDictionary, Variable
from hil_bench.canopen_device.pdo_parameters import COMMUNICATION_INDICES
from hil_bench.errors import ConfigError, printable
from hil_bench.frame import address_of

if TYPE_CHECKING:
    from hil_bench.canopen_device.nmt import NmtState


# The knowledge of one node: from its EDS and from its traffic on the bus.

_PDO_OBJECTS: Final = range(0x1400, 0x1C00)
_COB_IDS: Final = frozenset({0x1005, 0x1012, 0x1014})
_STORE: Final = 0x1010
_PRODUCES_SYNC: Final = 1 << 30

_STANDARD: Final[Mapping[int, tuple[str, DataType]]] = MappingProxyType(
    {
        0x1000: ("Device type", UNSIGNED32),
        0x1001: ("Error register", UNSIGNED8),
        0x1005: ("COB-ID SYNC", UNSIGNED32),
        0x1006: ("Communication cycle period", UNSIGNED32),
        0x1008: ("Manufacturer device name", VISIBLE_STRING),
        0x1009: ("Manufacturer hardware version", VISIBLE_STRING),
        0x100A: ("Manufacturer software version", VISIBLE_STRING),
        0x100C: ("Guard time", UNSIGNED16),
        0x100D: ("Life time factor", UNSIGNED8),
        0x1014: ("COB-ID EMCY", UNSIGNED32),
        0x1017: ("Producer heartbeat time", UNSIGNED16),
    }
)
_RECORDS: Final = (
    (range(0x1003, 0x1004), "Pre-defined error field", (UNSIGNED8, UNSIGNED32)),
    (range(0x1010, 0x1012), "Store or restore parameters", (UNSIGNED8, UNSIGNED32)),
    (range(0x1016, 0x1017), "Consumer heartbeat time", (UNSIGNED8, UNSIGNED32)),
    (range(0x1018, 0x1019), "Identity", (UNSIGNED8, UNSIGNED32)),
    (range(0x1600, 0x1800), "RPDO mapping", (UNSIGNED8, UNSIGNED32)),
    (range(0x1A00, 0x1C00), "TPDO mapping", (UNSIGNED8, UNSIGNED32)),
)
_PARAMETERS: Final = tuple(COMMUNICATION_INDICES.values())
_PARAMETER_TYPES: Final = {
    0: UNSIGNED8,
    1: UNSIGNED32,
    2: UNSIGNED8,
    3: UNSIGNED16,
    5: UNSIGNED16,
    6: UNSIGNED8,
}


class KnownNode:
    """One node of a bus, whose objects follow what is heard of them.

    Args:
        node_id: its node-ID.
        name: what it is called; empty where nobody has given it a name.
        objects: from its EDS; without them those that it shows on the bus.
        bus: the number of its bus.
        scales: what the numbers of bound objects stand for.
        protected_tpdos: numbers of the TPDOs that have a counter and a checksum; None for not
            known.

    Attributes:
        has_eds: whether its objects come from an EDS.
        state: as last heard of; None for not yet.
    """

    def __init__(
        self,
        node_id: int,
        name: str = "",
        objects: ObjectDictionary | None = None,
        *,
        bus: int = 0,
        scales: Mapping[tuple[int, int], Scale] = MappingProxyType({}),
        protected_tpdos: Collection[int] | None = None,
    ) -> None:
        self.node_id = node_id
        self.bus = bus
        self.has_eds = objects is not None
        self.objects = objects if objects is not None else ObjectDictionary(())
        self.state: NmtState | None = None
        self._name = name
        self._scales = scales
        self._protected_tpdos = protected_tpdos

    @property
    def name(self) -> str:
        """The name of the node: from the bench, from itself (0x1008), or from its node-ID."""
        if self._name:
            return self._name
        own = self.objects.find(0x1008, 0)
        text = own.value if own is not None and not self.has_eds else ""
        told = (
            f' "{printable(text.rstrip(chr(0)).strip())}"' if text and isinstance(text, str) else ""
        )
        return f"node {self.node_id}{told}"

    def number(self, index: int, subindex: int = 0, absent: int = 0) -> int:
        """Return the value of an integer object, or `absent`."""
        return number_in(self.objects, index, subindex, absent)

    def pdos(self) -> list[Pdo]:
        """Return the PDOs that exist now."""
        return list(find_pdos(self.objects, self._scales, self._protected_tpdos))

    def reader(self, index: int, subindex: int) -> Reader:
        """Return the reader of one object."""
        variable = self.objects.find(index, subindex)
        if variable is None and not self.has_eds and (standard := _standard(index, subindex)):
            variable = Variable(index, subindex, *standard)
            variable.value = None
            self.objects.add(variable)
        return Reader(self.objects, index, subindex, self._scales)

    @property
    def produces_sync(self) -> bool:
        """True if the node generates SYNC (bit 30 of 0x1005)."""
        return bool(self.number(0x1005) & _PRODUCES_SYNC)

    def identifier_of(self, index: int) -> int | None:
        """Return the identifier that a COB-ID parameter gives; None where it gives none."""
        return can_id(self.number(index, absent=DISABLED))

    def assume(self, index: int, subindex: int, raw: bytes) -> bool:
        """Take what a transfer says that an object holds; return whether frames now read otherwise.

        Args:
            index: of the object.
            subindex: of the object.
            raw: its bytes.
        """
        reader = self.reader(index, subindex)
        variable = self.objects.find(index, subindex)
        if variable is None or reader.data_type is None:
            return False
        try:
            value = reader.data_type.decode(raw)
        except SdoAbort:
            return False
        if index == _STORE:
            self._store()
            return False
        is_news = variable.is_open or variable.value != value
        variable.value, variable.is_open = value, False
        return is_news and (
            index in _PDO_OBJECTS
            or index in _COB_IDS
            or decides_scale(index, subindex)
            or index == 0x1008
        )

    def reset(self, indices: range) -> None:
        """Set the objects back to their power-on values, as a reset does."""
        if self.has_eds:
            self.objects.restore(indices)

    def _store(self) -> None:
        """Have the present values be those of power-on: 0x1010 was written."""
        for variable in self.objects:
            if variable.access.writable:
                variable.default = variable.value


class PdoOwner(NamedTuple):
    """A PDO and the node that sends or receives it."""

    node: KnownNode
    pdo: Pdo

    @property
    def address(self) -> int:
        """Its identifier and the number of its bus as one number."""
        return address_of(self.pdo.can_id, self.node.bus)


def _standard(index: int, subindex: int) -> tuple[str, DataType] | None:
    """Return name and data type of an object that CiA 301 gives every device."""
    if index in _STANDARD and subindex == 0:
        return _STANDARD[index]
    for indices, name, (of_count, of_entry) in _RECORDS:
        if index in indices:
            return name, of_entry if subindex else of_count
    if any(index in indices for indices in _PARAMETERS) and subindex in _PARAMETER_TYPES:
        return "PDO communication parameter", _PARAMETER_TYPES[subindex]
    return object_of(index, subindex)


# The nodes that a decoder knows beforehand: those of a bench, and those of EDS files.

_NODE_IDS = range(1, 128)


def nodes_of(
    config: BenchConfig, live: Mapping[str, ObjectDictionary] | None = None
) -> list[KnownNode]:
    """Return the nodes of a bench, but for those without a node-ID.

    Args:
        config: the bench.
        live: what the objects of the nodes hold now, by the nodes' names; without it what they
            hold at power-on.
    """
    buses = list(config.buses)
    found = []
    for settings in config.nodes:
        if settings.node_id == UNCONFIGURED:
            continue
        objects = load_objects(settings)
        for variable in () if live is None else live[settings.name]:
            own = objects.find(variable.index, variable.subindex)
            if own is not None:
                own.value = variable.value
        node = KnownNode(
            settings.node_id,
            settings.name,
            objects,
            bus=buses.index(settings.bus),
            scales=dict(_scales(config, settings)),
            protected_tpdos=settings.protected_tpdos,
        )
        found.append(node)
    return found


def _scales(config: BenchConfig, settings: NodeConfig) -> Iterator[tuple[tuple[int, int], Scale]]:
    """Yield what the objects that are bound to the plant stand for."""
    axes = {axis.name: axis for axis in config.axes}
    for binding in settings.bindings:
        quantity = axes[binding.axis].kind.by_name.get(binding.quantity)
        if quantity is not None and binding.scale:
            unit = display_unit(quantity.unit)
            scale = Scale(1.0 / (binding.scale * unit.factor), unit, binding.offset)
            yield (binding.index, binding.subindex), scale


def node_of_eds(text: str) -> KnownNode:
    """Return the node that ``5=vendor.eds`` names; what cannot be read of it is logged.

    Raises:
        ConfigError: the text has another form, or the file is no EDS.
    """
    number, sign, name = text.partition("=")
    if not sign or not number.strip().isdecimal() or int(number) not in _NODE_IDS or not name:
        raise ConfigError(f"--eds {text}: give NODE-ID=FILE, as in 5=vendor.eds")
    path, node_id = Path(name), int(number)
    objects = load_eds(path, node_id)
    warn_of_commissioning(path, node_id)
    warn_of_findings(path, (f for f in objects.findings if f.severity is Severity.ERROR))
    return KnownNode(node_id, f"{path.stem}_{node_id}", objects)


def merge_nodes(known: Iterable[KnownNode], more: Iterable[KnownNode]) -> list[KnownNode]:
    """Return all nodes; of two with one node-ID the later one."""
    merged = {(node.bus, node.node_id): node for node in known}
    merged.update({(node.bus, node.node_id): node for node in more})
    return list(merged.values())
