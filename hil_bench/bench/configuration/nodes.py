"""The tables ``[nodes.NAME]``, checked with each other and the axes; devices beside the nodes."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from hil_bench.bench.configuration.axes import Axes
from hil_bench.bench.configuration.bindings import is_script
from hil_bench.bench.configuration.loop import PROFILE_KEY, added_keys, node_keys
from hil_bench.canopen_device.nmt import UNCONFIGURED
from hil_bench.config.document import Document, read_named_sections
from hil_bench.config.objects import named_serial_number, parse_object
from hil_bench.config.settings import Given, Origin, Problems, Settings, convert, give, read_table
from hil_bench.config.values import describe
from hil_bench.devices.kinds.bindings import (
    CHAIN_TABLE,
    ScriptConfig,
    SinkConfig,
    SourceConfig,
    build_chain,
    read_chain,
)
from hil_bench.devices.kinds.kind import DeviceKind, NodeConfig
from hil_bench.devices.kinds.registry import GENERIC, KINDS, VALVE, kind_of
from hil_bench.errors import ConfigError
from hil_bench.plants.plant import AxisSettings

# Tables of devices beside the CANopen nodes, which abilities read before the nodes.


class OtherDrive(NamedTuple):
    """A driver of an axis that is no CANopen node.

    Attributes:
        what: how messages call it.
        place: of its axis.
        axis: that it commands.
    """

    what: str
    place: str
    axis: str | None


class PeerSection(Protocol):
    """The section of such a table.

    Attributes:
        is_given: whether the file has such devices, right or wrong.
    """

    is_given: bool

    @staticmethod
    def needs_axis(document: Document) -> bool:
        """Return True if a device of the file's table is connected to a plant."""

    @property
    def buses(self) -> Mapping[str, str]:
        """The bus of each device by its name."""

    def drives(self) -> Iterator[OtherDrive]:
        """Yield what commands axes."""

    def resolve(self) -> None:
        """As `Section.resolve`."""

    def build(self) -> dict[str, Any]:
        """As `Section.build`."""

    def tables(self) -> Iterable[Settings]:
        """As `Section.tables`."""


PeerSections = Mapping[str, PeerSection]
"""The sections by the names of their tables."""


def places_of(peers: PeerSections) -> dict[str, str]:
    """Return the bus of each device by its place, as ``j1939.joystick``."""
    return {
        f"{table}.{name}": bus
        for table, section in peers.items()
        for name, bus in section.buses.items()
    }


def drives_of(peers: PeerSections) -> Sequence[OtherDrive]:
    """Return everything of such devices that commands axes."""
    return [drive for section in peers.values() for drive in section.drives()]


# The tables ``[nodes.NAME]``: CANopen nodes, checked against each other and against the axes.

Bindings = Mapping[str, Sequence[SourceConfig | SinkConfig]]
"""The bindings of each node by its name."""

_NO_AXIS = "the bench has no plant: give it one as [plant.axis1], or the node an eds and no profile"


def read_nodes(
    document: Document, axes: Axes, problems: Problems, *, has_others: bool
) -> tuple[dict[str, Settings], dict[str, Settings]]:
    """Return the settings of each node, and of each sensor's measuring chain, by their names.

    A file without nodes has those of its first plant, unless it has other devices.
    """
    if "nodes" in document or has_others:
        sections = read_named_sections(document, "nodes", problems)
    else:
        sections = {
            name: give(f"nodes.{name}", node, Origin.DEFAULT, problems)
            for axis in list(axes.values())[:1]
            for name, node in axis.kind.default_nodes.items()
        }
    nodes, chains = {}, {}
    for name, given in sections.items():
        chain = given.pop(CHAIN_TABLE, None)
        node = nodes[name] = _read_node(f"nodes.{name}", given, problems)
        if "profile" in node:
            kind = kind_of(node["profile"].value)
            is_read = len(node) == len(node_keys(kind))  # a key with a problem is not there
            if is_read and (axis := _axis_of(node, axes)) is not None:
                kind.check(f"nodes.{name}", node, axis, problems)
            if chain is not None and kind.chain_unit is None:
                problems.add(chain.place, f"{kind.name} measures nothing; leave it out")
            settings = read_chain(f"nodes.{name}", kind.chain_unit, chain, problems)
            if settings is not None:
                chains[name] = settings
    return nodes, chains


def _axis_of(node: Settings, axes: Axes) -> AxisSettings | None:
    """Return the axis of a node: the one that it names, or the only one; None for no such axis."""
    if "axis" not in node:
        return None
    name = node["axis"].value
    if name is None and len(axes) == 1:
        name = next(iter(axes))
    return axes.get(name)


def needs_axis(document: Document, others: Sequence[bool]) -> bool:
    """Return True if the devices of a file are connected to an axis.

    Devices made from their EDS files alone have nothing, unless an object is bound to the plant.

    Args:
        document: the file.
        others: whether the devices of each table beside the nodes are.
    """
    nodes = document.get("nodes")
    if others and not nodes:
        return any(others)
    if not isinstance(nodes, dict) or not nodes or any(others):
        return True
    return not all(isinstance(node, dict) and _is_alone(node) for node in nodes.values())


def _is_alone(node: Mapping[str, object]) -> bool:
    objects = node.get("objects")
    values = objects.values() if isinstance(objects, dict) else ()
    is_bound = any(isinstance(value, dict) and not is_script(value) for value in values)
    kind = _find_kind(node.get("profile", GENERIC.name))
    has_eds = "eds" in node or (kind is not None and kind.eds is not None)
    return has_eds and kind is not None and not kind.has_axis and not is_bound


def _find_kind(name: object) -> DeviceKind[Any] | None:
    """Return the kind of a name; None where there is none, which the reader of the key notes."""
    try:
        return KINDS.find(name) if isinstance(name, str) else None
    except ConfigError:
        return None


def resolve_nodes(
    nodes: Mapping[str, Settings], axes: Axes, base: Path, problems: Problems
) -> None:
    """Fill in what a node takes from elsewhere: its axis, its files, what its kind asks for."""
    for name, node in nodes.items():
        if "axis" in node:
            _resolve_axis(problems.place(f"nodes.{name}", "axis"), node, list(axes), problems)
        _resolve_eds(problems.place(f"nodes.{name}", "eds"), node, base, problems)
        _resolve_storage(problems.place(f"nodes.{name}", "storage"), node, base, problems)
        if "axis" in node and (axis := axes.get(node["axis"].value)):
            kind_of(node["profile"].value).resolve(node, axis)


def check_nodes(
    nodes: Mapping[str, Settings],
    axes: Axes,
    bindings: Bindings,
    others: Sequence[OtherDrive],
    problems: Problems,
) -> None:
    """Note node-IDs and serial numbers that clash, and axes that have no valve or several."""
    _check_node_ids(nodes, problems)
    _check_serial_numbers(nodes, problems)
    if all(node["axis"].value in axes for node in nodes.values() if "axis" in node):
        for name, axis in axes.items():
            elsewhere = [drive for drive in others if drive.axis == name]
            _check_drives(name, axis.kind.command.name, nodes, bindings, elsewhere, problems)


def build_node_config(
    name: str,
    node: Settings,
    bindings: Sequence[SourceConfig | SinkConfig],
    scripts: tuple[ScriptConfig, ...],
    chain: Settings | None,
    problems: Problems,
) -> NodeConfig:
    """Return the record of a checked node; its places are named as `problems` does."""
    kind = kind_of(node["profile"].value)
    values = convert(node, node_keys(kind))
    del values["profile"]
    added = {name: values.pop(name) for name in convert(node, added_keys())}
    storage = values["storage"]
    paths = {"eds": Path(values["eds"]), "storage": None if storage is None else Path(storage)}
    objects = {
        parse_object(name): value
        for name, value in (values["objects"] or {}).items()
        if not isinstance(value, dict)
    }
    bound: dict[str, Any] = {
        "sources": tuple(bound for bound in bindings if isinstance(bound, SourceConfig)),
        "scripts": scripts,
    }
    if kind is GENERIC:
        bound["sinks"] = tuple(bound for bound in bindings if isinstance(bound, SinkConfig))
    if chain is not None and kind.chain_unit is not None:
        bound["chain"] = build_chain(kind.chain_unit, chain)
    rest = (
        paths
        | bound
        | {"objects": objects, "added": added, "place": problems.place(f"nodes.{name}")}
    )
    record: NodeConfig = kind.record(name=name, kind=kind, **{"axis": None} | values | rest)
    return record


def _read_node(table: str, given: Mapping[str, Given], problems: Problems) -> Settings:
    profile = given.get("profile")
    name = GENERIC.name if profile is None and "eds" in given else profile and profile.value
    kind = _find_kind(name)
    if kind is None:
        # Which other keys are right depends on the profile, so the message about it must do.
        return read_table(table, {"profile": profile} if profile else {}, (PROFILE_KEY,), problems)
    return read_table(table, given, node_keys(kind), problems)


def _resolve_axis(place: str, node: Settings, axes: list[str], problems: Problems) -> None:
    axis = node["axis"]
    if axis.value is None and len(axes) == 1:
        node["axis"] = axis._replace(value=axes[0])
    elif axis.value not in axes:
        wrong = "missing" if axis.value is None else f"there is no axis {describe(axis.value)}"
        right = f"give one of {', '.join(axes)}" if axes else _NO_AXIS
        problems.add(place, f"{wrong}; {right}")


def _resolve_eds(place: str, node: Settings, base: Path, problems: Problems) -> None:
    eds = node["eds"]
    path = base / eds.value if eds.value else Path(kind_of(node["profile"].value).eds or "")
    if not path.is_file():
        problems.add(place, f"there is no file {path}; give the path of an EDS file")
    node["eds"] = eds._replace(value=str(path))


def _resolve_storage(place: str, node: Settings, base: Path, problems: Problems) -> None:
    storage = node["storage"]
    if storage.value is None:
        return
    folder = base / storage.value
    if folder.exists() and not folder.is_dir():
        problems.add(place, f"{folder} is no folder; give the path of one, which may be new")
    node["storage"] = storage._replace(value=str(folder))


def _check_node_ids(nodes: Mapping[str, Settings], problems: Problems) -> None:
    owners: dict[tuple[str, int], str] = {}
    used = {(node["bus"].value, node["node_id"].value) for node in nodes.values()}
    for name, node in nodes.items():
        bus, node_id = node["bus"].value, node["node_id"].value
        if node_id == UNCONFIGURED:
            continue
        owner = owners.setdefault((bus, node_id), name)
        if owner != name:
            free = min((n for n in range(1, 128) if (bus, n) not in used), default=None)
            right = "a bus has room for 127 nodes" if free is None else f"{free} is free"
            place = problems.place(f"nodes.{name}", "node_id")
            problems.add(place, f"{node_id} is taken by nodes.{owner}; {right}")


def _check_serial_numbers(nodes: Mapping[str, Settings], problems: Problems) -> None:
    """LSS tells two devices of the same kind apart by their serial numbers alone."""
    owners: dict[tuple[str, int], str] = {}
    for name, node in nodes.items():
        serial_number = node["serial_number"].value
        place = problems.place(f"nodes.{name}", "serial_number")
        if serial_number is None:
            serial_number = named_serial_number(name)
        owner = owners.setdefault((node["eds"].value, serial_number), name)
        if owner != name:
            right = "give each device of a kind its own"
            problems.add(place, f"{serial_number} is that of nodes.{owner} too; {right}")


def _check_drives(
    axis: str,
    command: str,
    nodes: Mapping[str, Settings],
    bindings: Bindings,
    others: Sequence[OtherDrive],
    problems: Problems,
) -> None:
    """Note an axis that nobody commands, or more than one device."""
    drives = [
        (f"the valve nodes.{name}", problems.place(f"nodes.{name}", "axis"))
        for name, node in nodes.items()
        if kind_of(node["profile"].value).is_drive and node["axis"].value == axis
    ] + [
        (f"the sink {bound.place}", f"{bound.place}.sink")
        for bounds in bindings.values()
        for bound in bounds
        if isinstance(bound, SinkConfig) and bound.axis == axis
    ]
    drives += [(drive.what, drive.place) for drive in others]
    if not drives:
        right = f'give it a node with profile = "{VALVE.name}" and axis = "{axis}"'
        other = f'or bind an object with sink = "{axis}.{command}"'
        problems.add(problems.place(f"plant.{axis}"), f"has no valve; {right}, {other}")
    for _, place in drives[1:]:
        right = "give each axis one valve or one sink"
        problems.add(place, f"{axis} has {drives[0][0]} already; {right}")
