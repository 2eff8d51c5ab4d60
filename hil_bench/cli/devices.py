"""`hil-bench devices`: what is on the bus, without opening one."""

import argparse
import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass

from hil_bench.bench.configuration import BenchConfig, NodeConfig, SinkConfig, SourceConfig
from hil_bench.bench.configuration.records import FIRST_BUS, ShownDevice
from hil_bench.bench.power_on import load_objects
from hil_bench.canopen_device.nmt import UNCONFIGURED
from hil_bench.canopen_device.object_dictionary import ObjectDictionary
from hil_bench.canopen_device.pdo_parameters import (
    COMMUNICATION_INDICES,
    EVENT_DRIVEN,
    SYNCHRONOUS_ACYCLIC,
    Direction,
    PdoParameters,
)
from hil_bench.cli.arguments import add_bench_arguments, load_bench_config
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.results import add_json_argument, print_lines
from hil_bench.devices.kinds.bindings import find_bound
from hil_bench.errors import ConfigError

# The device table: what is on the bus, and on which identifiers one talks to it.


@dataclass(frozen=True, slots=True)
class ObjectRow:
    """One object in a PDO.

    Attributes:
        index: its index.
        subindex: its sub-index.
        name: its name in the EDS.
        data_type: its data type, as in ``INTEGER16``.
    """

    index: int
    subindex: int
    name: str
    data_type: str


@dataclass(frozen=True, slots=True)
class PdoRow:
    """One PDO that exists at power-on, as the device sees it.

    Attributes:
        name: ``RPDO1`` and so on.
        can_id: its identifier.
        transmission_type: 0 to 240 synchronous, 254 and 255 event driven.
        event_time_ms: TPDO: longest time between two, RPDO: time-out; 0 for none [ms].
        objects: what it carries, in order.
    """

    name: str
    can_id: int
    transmission_type: int
    event_time_ms: int
    objects: tuple[ObjectRow, ...]


@dataclass(frozen=True, slots=True)
class BoundObject:
    """One object that is bound to the plant.

    Attributes:
        object: the object, as in ``0x6401.01``.
        name: its name in the EDS.
        data_type: its data type, as in ``INTEGER16``.
        role: "source" where it shows a quantity, "sink" where it commands one.
        quantity: that quantity, as in ``axis1.P_A``.
    """

    object: str
    name: str
    data_type: str
    role: str
    quantity: str


@dataclass(frozen=True, slots=True)
class DeviceRow:
    """One node of the bench.

    Attributes:
        name: as in ``[nodes.NAME]``.
        node_id: its node-ID; 255 for none.
        profile: its device profile.
        axis: the axis that it belongs to; None for one made from its EDS file alone.
        eds: its EDS file.
        pdos: its PDOs; none without a node-ID.
        bound: its objects that are bound to the plant.
        bus: the bus that it is on, as in ``[buses.NAME]``; ``bus`` for the first.
    """

    name: str
    node_id: int
    profile: str
    axis: str | None
    eds: str
    pdos: tuple[PdoRow, ...]
    bound: tuple[BoundObject, ...] = ()
    bus: str = FIRST_BUS


def read_devices(config: BenchConfig) -> list[DeviceRow]:
    """Return the devices of a bench, from their EDS files, bus by bus in the order of node-IDs.

    Raises:
        ConfigError: EDS files or objects that cannot serve, a line each.
    """
    devices, problems = [], []
    order = list(config.buses)
    for node in sorted(config.nodes, key=lambda node: (order.index(node.bus), node.node_id)):
        try:
            devices.append(_read_device(node))
        except ConfigError as error:
            problems.append(str(error))
    if problems:
        # Nodes may share an EDS, and then its problem.
        raise ConfigError("\n".join(dict.fromkeys(problems)))
    return devices


def device_table(config: BenchConfig) -> str:
    """Return the devices of a bench as text for people; `read_devices` says what can go wrong."""
    blocks = [_device_lines(device) for device in read_devices(config)]
    for title, content, lines in _others(config):
        head = (str(content[key] or "") for key in ("name", "kind", "axis", "bus"))
        blocks.append(iter((_head(title, *head), *lines)))
    return "\n\n".join(map("\n".join, blocks))


def _others(config: BenchConfig) -> Iterator[ShownDevice]:
    return (each for part in config.parts for each in part.shown_devices(config))


def _read_device(node: NodeConfig) -> DeviceRow:
    object_dictionary = load_objects(node)
    # Without a node-ID there are no identifiers yet.
    pdos = () if node.node_id == UNCONFIGURED else tuple(_read_pdos(object_dictionary))
    return DeviceRow(
        name=node.name,
        node_id=node.node_id,
        bus=node.bus,
        profile=node.profile,
        axis=node.axis,
        eds=str(node.eds),
        pdos=pdos,
        bound=tuple(_read_binding(object_dictionary, binding) for binding in node.bindings),
    )


def _read_binding(
    object_dictionary: ObjectDictionary, binding: SourceConfig | SinkConfig
) -> BoundObject:
    variable = find_bound(object_dictionary, binding)
    return BoundObject(
        object=binding.name,
        name=variable.name,
        data_type=variable.data_type.name,
        role="sink" if isinstance(binding, SinkConfig) else "source",
        quantity=f"{binding.axis}.{binding.quantity}",
    )


def _read_pdos(object_dictionary: ObjectDictionary) -> Iterator[PdoRow]:
    for direction, indices in COMMUNICATION_INDICES.items():
        for index in object_dictionary.indices(indices):
            parameters = PdoParameters(object_dictionary, index, direction)
            if parameters.can_id is not None:
                yield _read_pdo(parameters, parameters.can_id, direction)


def _read_pdo(parameters: PdoParameters, can_id: int, direction: Direction) -> PdoRow:
    mapping = parameters.mapping()
    return PdoRow(
        name=f"{direction.value}{parameters.number}",
        can_id=can_id,
        transmission_type=parameters.transmission_type,
        event_time_ms=parameters.event_time // 1_000_000,
        objects=tuple(
            ObjectRow(variable.index, variable.subindex, variable.name, variable.data_type.name)
            for variable in (mapping.variables if mapping else ())
        ),
    )


def _device_lines(device: DeviceRow) -> Iterator[str]:
    node_id = "unconfigured" if device.node_id == UNCONFIGURED else device.node_id
    yield _head(f"node {node_id}", device.name, device.profile, device.axis, device.bus)
    yield f"  EDS    {device.eds}"
    for pdo in device.pdos:
        head = f"  {pdo.name:6} 0x{pdo.can_id:03X}  {_transmission(pdo):30}"
        for mapped in pdo.objects:
            place = f"0x{mapped.index:04X}.{mapped.subindex:02X}"
            yield f"{head}  {place}  {mapped.name} ({mapped.data_type})"
            head = " " * len(head)
        if not pdo.objects:
            yield head.rstrip()
    for bound in device.bound:
        arrow = "<-" if bound.role == "source" else "->"
        head = f"  {bound.role:6} {bound.object} {arrow} {bound.quantity}"
        yield f"{head:48}  {bound.name} ({bound.data_type})"


def _head(number: str, name: str, kind: str, axis: str | None, bus: str) -> str:
    where = "" if bus == FIRST_BUS else f"on {bus}"
    return "  ".join(filter(None, (number, name, kind, axis, where)))


def _transmission(pdo: PdoRow) -> str:
    kind, is_rpdo = pdo.transmission_type, pdo.name.startswith(Direction.RPDO.value)
    if kind in EVENT_DRIVEN:
        how = "on event"
    elif is_rpdo:
        how = "with the next SYNC"
    elif kind == SYNCHRONOUS_ACYCLIC:
        how = "on event, with SYNC"
    else:
        how = "every SYNC" if kind == 1 else f"every {kind} SYNCs"
    timer = f", {'time-out' if is_rpdo else 'timer'} {pdo.event_time_ms} ms"
    return f"{kind:3} {how}{timer if pdo.event_time_ms else ''}"


_EXAMPLES = """\
examples:
  hil-bench devices                     the built-in bench
  hil-bench devices bench.toml
  hil-bench devices bench.toml --json
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "devices",
        description="Print the device table: node-ID, profile, EDS file and the PDOs of each node\n"
        "at power-on, with identifier, transmission type, timer and mapped objects; address and\n"
        "parameter groups of each J1939 device.",
        epilog=_EXAMPLES,
    )
    add_bench_arguments(parser)
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the device table."""
    config = load_bench_config(args)
    if args.json:
        rows = [asdict(device) for device in read_devices(config)]
        rows += [dict(each.content) for each in _others(config)]
        print(json.dumps(rows, indent=2))
    else:
        print_lines(args, device_table(config))
    return ExitCode.DONE
