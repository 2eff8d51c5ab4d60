"""The nodes that a decoder knows beforehand: those of a bench, and those of EDS files."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from hil_bench.abilities.eyes.known_node import KnownNode
from hil_bench.abilities.eyes.scaling import Scale
from hil_bench.bench.configuration import BenchConfig, NodeConfig
from hil_bench.bench.power_on import load_objects
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.nmt import UNCONFIGURED
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.errors import ConfigError
from hil_bench.shown_units import display_unit

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
    """Return the node that ``5=vendor.eds`` names.

    Raises:
        ConfigError: the text has another form, or the file is no EDS.
    """
    number, sign, name = text.partition("=")
    if not sign or not number.strip().isdecimal() or int(number) not in _NODE_IDS or not name:
        raise ConfigError(f"--eds {text}: give NODE-ID=FILE, as in 5=vendor.eds")
    path = Path(name)
    return KnownNode(int(number), f"{path.stem}_{int(number)}", load_eds(path, int(number)))


def merge_nodes(known: Iterable[KnownNode], more: Iterable[KnownNode]) -> list[KnownNode]:
    """Return all nodes; of two with one node-ID the later one."""
    merged = {(node.bus, node.node_id): node for node in known}
    merged.update({(node.bus, node.node_id): node for node in more})
    return list(merged.values())
