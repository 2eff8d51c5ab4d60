"""The objects of a node for a page: the list of its EDS, and which PDOs carry what at present."""

from collections.abc import Awaitable, Callable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from hil_bench.canopen_device.cob_id import can_id
from hil_bench.canopen_device.datatypes import BooleanType, IntegerType, RealType
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.pdo_mapping import MappingEntry
from hil_bench.canopen_device.pdo_parameters import COMMUNICATION_INDICES
from hil_bench.config.objects import name_object
from hil_bench.errors import ConfigError

Get = Callable[[str, str], Awaitable[Any]]
"""Returns what an object of a node holds, by the node's name and the object's: "0x1017"."""

_TO_MAPPING = 0x200
_MOST_MAPPED = 64


def device_of(hello: Mapping[str, Any], node: str) -> Mapping[str, Any]:
    """Return a bench's description of one of its nodes.

    Raises:
        ConfigError: there is no such node.
    """
    devices: Mapping[str, Mapping[str, Any]] = hello.get("devices", {})
    if node not in devices:
        raise ConfigError(f"node {node!a}: there is none; give one of {', '.join(devices)}")
    return devices[node]


def list_objects(device: Mapping[str, Any]) -> list[dict[str, object]]:
    """Return the objects of a device; `EdsError` where its EDS cannot be read."""
    return [
        {
            "name": name_object(variable.index, variable.subindex),
            "text": variable.name,
            "type": variable.data_type.name,
            "is_number": isinstance(variable.data_type, (BooleanType, IntegerType, RealType)),
            "access": variable.access.value,
            "is_writable": variable.access.writable,
        }
        for variable in _objects(device)
    ]


async def list_pdos(hello: Mapping[str, Any], get: Get) -> list[dict[str, object]]:
    """Return the PDOs of all nodes as they are at present: COB-ID, name, and what they carry."""
    found = []
    for node, device in hello.get("devices", {}).items():
        objects = _objects(device)
        for kind, indices in COMMUNICATION_INDICES.items():
            for index in objects.indices(indices):
                identifier = can_id(await get(node, name_object(index, 1)) or 0)
                if identifier is None:
                    continue
                raws = await _mapping(node, index + _TO_MAPPING, get)
                found.append(
                    {
                        "id": identifier,
                        "bus": device["bus"],
                        "node": node,
                        "pdo": f"{kind.value}{index - indices.start + 1}",
                        "signals": [*_signals(raws, objects)],
                    }
                )
    return found


def _objects(device: Mapping[str, Any]) -> ObjectDictionary:
    return _load(str(device["eds"]), int(device["node_id"]))


@lru_cache(maxsize=64)
def _load(eds: str, node_id: int) -> ObjectDictionary:
    return load_eds(Path(eds), node_id)


async def _mapping(node: str, index: int, get: Get) -> list[int]:
    count = await get(node, name_object(index, 0)) or 0
    return [
        int(await get(node, name_object(index, sub)) or 0)
        for sub in range(1, min(count, _MOST_MAPPED) + 1)
    ]


def _signals(raws: list[int], objects: ObjectDictionary) -> Iterator[dict[str, object]]:
    shift = 0
    for raw in raws:
        entry = MappingEntry.parse(raw)
        variable = objects.find(entry.index, entry.subindex)
        yield {
            "text": variable.name if variable else "",
            "name": name_object(entry.index, entry.subindex)
            if variable
            else f"0x{entry.index:04X}",
            "type": variable.data_type.name if variable else "",
            "shift": shift,
            "bits": entry.bits,
        }
        shift += entry.bits
