"""The desk of the panel: what a browser asks for, and the objects that it may set."""

import contextlib
import re
from collections.abc import Awaitable, Callable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from hil_bench.abilities.faults.live import fault_fields
from hil_bench.abilities.live import messages
from hil_bench.abilities.panel.hub import Hub, Viewer
from hil_bench.abilities.panel.layouts import (
    check_layout,
    list_layouts,
    path_of,
    read_layout,
    write_layout,
)
from hil_bench.abilities.panel.record import (
    SUFFIX,
    RecordForm,
    make_scenario,
    play_test,
    replay_run,
    write_test,
)
from hil_bench.abilities.scenario.writing import to_toml
from hil_bench.canopen_device.datatypes import BooleanType, IntegerType, RealType
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.frame import can_id
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.pdo_parameters import COMMUNICATION_INDICES, MappingEntry
from hil_bench.config.objects import name_object
from hil_bench.errors import ConfigError, HilBenchError

# The objects of a node for a page: the list of its EDS, and which PDOs carry what at present.

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


# The requests of a page: checked, then done by the panel itself or by the bench.

_FORM: Mapping[str, Any] = {
    "file": messages.TEXT,
    "title": messages.TEXT,
    "begin_s": messages.NUMBER,
    "end_s": messages.NUMBER,
    "lead_s": messages.NUMBER,
    "controller": messages.TEXT,
    "requirement": messages.TEXT,
    "that": messages.TEXT,
}

_LAYOUT = messages.Field(lambda value: isinstance(value, dict), "a layout")

_BY_BENCH = (
    *("histograms", "journal", "mark", "stop", "stop_recording"),
    *("clear_fault", "get_object", "set_object"),
)
_RECORDING = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,60}\.mf4")

PAGE_ACTIONS: messages.Actions = {
    **{name: messages.known_actions()[name] for name in (*_BY_BENCH, "set_plant")},
    "fault": {
        "kind": messages.TEXT,
        "target": messages.TEXT,
        "keys": messages.TABLE._replace(is_needed=False),
    },
    "want": {
        "frames": messages.SWITCH._replace(is_needed=False),
        "marks": messages.SWITCH._replace(is_needed=False),
    },
    "choose": {"bench": messages.TEXT},
    "objects": {"node": messages.TEXT},
    "pdos": {},
    "record": {"file": messages.TEXT},
    "preview": _FORM,
    "replay": {"key": messages.TEXT},
    "test": {**_FORM, "replaces": messages.SWITCH},
    "layouts": {},
    "layout": {"name": messages.TEXT},
    "save_layout": {"name": messages.TEXT, "layout": _LAYOUT, "replaces": messages.SWITCH},
}
"""What a page may ask for: what a bench may be asked, less `watch`, and what the panel does."""

Act = Callable[[Viewer, dict[str, Any]], Awaitable[object]]


class Desk:
    """Does what pages ask for.

    Args:
        hub: leads to the bench.
        folder: where tests and recordings are written.
        layout: the file of the layout that pages open first; None for that of the machine.
    """

    def __init__(self, hub: Hub, folder: Path, layout: Path | None = None) -> None:
        self._hub = hub
        self._folder = folder
        self._layout = layout
        self._acts: Mapping[str, Act] = {
            "fault": self._fault,
            "want": self._want,
            "choose": self._choose,
            "objects": self._objects,
            "pdos": self._pdos,
            "record": self._record,
            "preview": self._preview,
            "test": self._test,
            "layouts": self._layouts,
            "layout": self._read_layout,
            "save_layout": self._save_layout,
            "replay": self._replay,
        }

    async def answer(self, viewer: Viewer, text: str) -> bytes:
        """Do what a message asks for and return the answer."""
        number: int | None = None
        content: dict[str, object]
        try:
            request = messages.parse_request(text.encode(errors="replace"), PAGE_ACTIONS)
            number = request.number
            act = self._acts.get(request.action)
            if act is not None:
                content = {"value": await act(viewer, request.fields)}
            else:
                value = await self._hub.bench.request(request.action, **request.fields)
                content = {"value": value}
        except messages.RequestError as error:
            number, content = error.number, {"error": str(error)}
        except HilBenchError as error:
            content = {"error": str(error)}
        return messages.encode({"type": "answer", "id": number, **content})

    async def _fault(self, _viewer: Viewer, fields: dict[str, Any]) -> object:
        bench = self._hub.bench
        table = {**fields.get("keys", {}), "kind": fields["kind"], "target": fields["target"]}
        return await bench.request("begin_fault", **fault_fields(table, bench.hello))

    async def _want(self, viewer: Viewer, fields: dict[str, Any]) -> None:
        viewer.wants_frames = fields.get("frames", viewer.wants_frames)
        viewer.wants_marks = fields.get("marks", viewer.wants_marks)
        self._hub.review()

    async def _choose(self, _viewer: Viewer, fields: dict[str, Any]) -> None:
        self._hub.choose(fields["bench"])

    async def _objects(self, _viewer: Viewer, fields: dict[str, Any]) -> object:
        return list_objects(device_of(self._hub.bench.hello, fields["node"]))

    async def _pdos(self, _viewer: Viewer, _fields: dict[str, Any]) -> object:
        bench = self._hub.bench

        async def get(node: str, name: str) -> Any:  # noqa: ANN401 - what an object holds
            with contextlib.suppress(ConfigError):
                return await bench.request("get_object", node=node, name=name)
            return None

        return await list_pdos(bench.hello, get)

    async def _record(self, _viewer: Viewer, fields: dict[str, Any]) -> object:
        """Have the bench begin a recording.

        Raises:
            ConfigError: the name of its file cannot be, or is there already.
        """
        name = fields["file"]
        if not _RECORDING.fullmatch(name):
            raise ConfigError(f"file {name!a}: give up to 61 letters, digits, _ or -, and .mf4")
        path = self._folder / name
        if path.exists():
            raise ConfigError(f"{path} is there already; give another name")
        return await self._hub.bench.request("start_recording", path=str(path))

    async def _preview(self, _viewer: Viewer, fields: dict[str, Any]) -> object:
        scenario, remarks = await self._scenario(fields)
        return {"path": str(scenario.path), "text": to_toml(scenario), "remarks": remarks}

    async def _test(self, _viewer: Viewer, fields: dict[str, Any]) -> object:
        replaces = fields.pop("replaces")
        scenario, remarks = await self._scenario(fields)
        write_test(scenario, replaces=replaces)
        found = await play_test(scenario.path)
        return {"path": str(scenario.path), "remarks": remarks, **found}

    def _layout_folder(self) -> Path:
        """Return the folder of layouts: that of the bench's file, or that of tests."""
        file = self._hub.bench.hello.get("bench_file")
        return Path(str(file)).parent if file else self._folder

    async def _layouts(self, _viewer: Viewer, _fields: dict[str, Any]) -> object:
        file = self._hub.bench.hello.get("bench_file")
        found: dict[str, Any] = {
            "names": list_layouts(self._layout_folder()),
            "bench": Path(str(file)).name if file else "",
            "first": None,
        }
        if self._layout is not None:
            found["first"] = {"path": str(self._layout), "layout": read_layout(self._layout)}
        return found

    async def _read_layout(self, _viewer: Viewer, fields: dict[str, Any]) -> object:
        return read_layout(path_of(fields["name"], self._layout_folder()))

    async def _save_layout(self, _viewer: Viewer, fields: dict[str, Any]) -> object:
        path = path_of(fields["name"], self._layout_folder())
        layout = check_layout(fields["layout"], "the layout")
        write_layout(layout, path, replaces=fields["replaces"])
        return {"path": str(path)}

    async def _replay(self, _viewer: Viewer, fields: dict[str, Any]) -> object:
        work = self._hub.bench.hello.get("work") or {}
        return await replay_run(work.get("again") or [], fields["key"])

    async def _scenario(self, fields: dict[str, Any]) -> Any:  # noqa: ANN401 - of `make_scenario`
        bench = self._hub.bench
        form = RecordForm(**fields)
        journal = await bench.request("journal")
        path = self._folder / f"{form.file}{SUFFIX}"
        return make_scenario(form, path, bench.hello, journal)
