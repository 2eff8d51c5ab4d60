"""The devices of a bus compared with a configuration, and the differences settled."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from canopen.objectdictionary import ODVariable, datatypes

from hil_bench.abilities.commissioning.discovery import Method, Sighting, discover
from hil_bench.bench.configuration import BenchConfig, NodeConfig
from hil_drivers import DriverError, DriverTimeoutError, Network, Node, SdoAbortError
from hil_drivers.concise_dcf import INVALID, TO_MAPPING, ConciseEntry, pack_concise_dcf, pdo_of

# Compares what is on a bus with a bench's configuration and its EDS files.

IDENTITY = ((0x1000, 0), (0x1018, 1), (0x1018, 2), (0x1018, 3))
"""What a device cannot change: device type, vendor, product, revision."""

REVISION = IDENTITY[-1]
SERIAL_NUMBER = (0x1018, 4)

MAPPING = (range(0x1600, 0x1800), range(0x1A00, 0x1C00))
"""What the PDOs carry: the indices of RPDOs and of TPDOs."""

# Commands and clocks in the guise of values: pre-defined error field, store, restore, time stamp,
# high resolution time stamp, verify configuration and what follows it.
_NO_SETTINGS = (0x1003, 0x1010, 0x1011, 0x1012, 0x1013, *range(0x1F20, 0x1F60))

_COMMUNICATION = (range(0x1400, 0x1600), range(0x1800, 0x1A00))
_RPDO_MAPPING = range(0x1600, 0x1800)
_NUMBERS = frozenset((*datatypes.INTEGER_TYPES, *datatypes.FLOAT_TYPES, datatypes.BOOLEAN))

ObjectKey = tuple[int, int]
"""Index and sub-index."""


class Mend(Enum):
    """The remedy for a difference."""

    WRITE = "write"
    """The right value can be written to the device."""
    NODE = "node"
    """Somebody has to look at the node or at the file that describes it."""


@dataclass(frozen=True, slots=True)
class Difference:
    """One thing that is not as it should be.

    Attributes:
        node_id: the node.
        what: says what is wrong and what would be right, in one line.
        mend: what can be done about it.
        key: the object; None where the node itself is concerned.
        right: the value that it should hold; None where there is none.
        is_missing: whether the node does not answer at all.
    """

    node_id: int
    what: str
    mend: Mend
    key: ObjectKey | None = None
    right: float | None = None
    is_missing: bool = False


def compare(
    network: Network, config: BenchConfig, *, patience: float = 1.0, timeout: float = 0.5
) -> list[Difference]:
    """Return every difference between a bus and the configuration; reads only.

    Args:
        network: an open network.
        config: the bench as it should be.
        patience: time that the nodes have to show themselves [s].
        timeout: longest wait for each SDO answer [s].
    """
    sightings = {seen.node_id: seen for seen in discover(network, Method.SDO, patience=patience)}
    expected = {node.node_id: node for node in config.nodes}
    differences: list[Difference] = []
    for node_id in sorted(sightings.keys() | expected.keys()):
        node = expected.get(node_id)
        if node is None:
            differences.append(_unexpected(node_id, config))
        elif node_id not in sightings:
            differences.append(_missing(node))
        else:
            differences += _compare_node(network, node, sightings[node_id], timeout)
    return differences


def expected_values(node: Node, config: NodeConfig) -> dict[ObjectKey, int | float]:
    """Return the number that each configurable object should hold, by EDS and configuration.

    An object for which neither gives a value has no right one, nor has one that is bound to the
    plant. Entries of a PDO mapping beyond its number of entries mean nothing.
    """
    values = {
        (variable.index, variable.subindex): value
        for variable in _variables(node)
        if _is_setting(variable) and (value := _number(_given(variable))) is not None
    }
    for key, given in config.objects.items():
        if (number := _number(given)) is not None:
            values[key] = number
    passing = _commanded(values) | {(bound.index, bound.subindex) for bound in config.bindings}
    return {
        key: value
        for key, value in values.items()
        if key not in passing and not _is_beyond_mapping(key, values)
    }


def _unexpected(node_id: int, config: BenchConfig) -> Difference:
    file = config.path or "the built-in bench"
    what = f"node {node_id}: is on the bus, but {file} has no node with this node-ID"
    return Difference(node_id, what, Mend.NODE)


def _missing(node: NodeConfig) -> Difference:
    what = (
        f"node {node.node_id} ({node.name}): does not answer; "
        "check node-ID, power, wiring and bit rate"
    )
    return Difference(node.node_id, what, Mend.NODE, is_missing=True)


def _compare_node(
    network: Network, config: NodeConfig, sighting: Sighting, timeout: float
) -> Iterator[Difference]:
    name = f"node {config.node_id} ({config.name})"
    if sighting.answers > 1:
        what = f"{name}: {sighting.answers} devices answer under this node-ID; one is right"
        yield Difference(config.node_id, what, Mend.NODE)
        return
    node = network.add_node(config.node_id, config.eds, sdo_timeout=timeout)
    try:
        identity = list(_compare_identity(node, config, name))
        yield from identity
        if not identity:  # another device would differ in everything else
            yield from _compare_settings(node, config, name)
    except DriverTimeoutError as error:
        what = f"{name}: stopped answering: {error.what}"
        yield Difference(config.node_id, what, Mend.NODE)
    except DriverError as error:
        yield Difference(config.node_id, f"{name}: {error.what}", Mend.NODE)


def _compare_identity(node: Node, config: NodeConfig, name: str) -> Iterator[Difference]:
    right = {key: node.default(*key, otherwise=-1) for key in IDENTITY if node.has(*key)}
    # 0 is what an EDS says of a device that any vendor may have made; -1 is what it leaves open.
    device_type = IDENTITY[0]
    right = {k: value for k, value in right.items() if value > 0 or (value, k) == (0, device_type)}
    source = str(config.eds)
    if config.serial_number is not None:
        right[SERIAL_NUMBER] = config.serial_number
    for key, value in right.items():
        found = node.read_integer(*key)
        if found != value:
            by = "the configuration" if key == SERIAL_NUMBER else source
            what = (
                f"{name}: {_place(node, key)} is 0x{found:08X}; 0x{value:08X} by {by}: another "
                "device, or the EDS of another"
            )
            yield Difference(config.node_id, what, Mend.NODE, key)


def _compare_settings(node: Node, config: NodeConfig, name: str) -> Iterator[Difference]:
    for key, right in expected_values(node, config).items():
        by = "the configuration" if key in config.objects else str(config.eds)
        try:
            found = node.read(*key)
        except SdoAbortError as error:
            what = f"{name}: {_place(node, key)} cannot be read, {error.reason}; {by} has it"
            yield Difference(config.node_id, what, Mend.NODE, key)
            continue
        if found != right:
            values = f"is {_text(key, found)}; {_text(key, right)} by {by}"
            what = f"{name}: {_place(node, key)} {values}"
            yield Difference(config.node_id, what, Mend.WRITE, key, right)


def _variables(node: Node) -> Iterator[ODVariable]:
    for entry in node.object_dictionary.values():
        yield from [entry] if isinstance(entry, ODVariable) else entry.values()


def _is_setting(variable: ODVariable) -> bool:
    """Return True if it is a number that is read and written, and stands for no command."""
    return (
        variable.access_type in {"rw", "rwr", "rww"}
        and variable.data_type in _NUMBERS
        and variable.index not in _NO_SETTINGS
    )


def _given(variable: ODVariable) -> object:
    """Return the value of an object in a DCF, else in an EDS."""
    return variable.default if variable.value is None else variable.value


def _number(given: object) -> int | float | None:
    return given if isinstance(given, int | float) else None


def _commanded(values: Mapping[ObjectKey, int | float]) -> set[ObjectKey]:
    """Return the objects that RPDOs bring: they hold commands, not settings."""
    commanded = set()
    for (index, subindex), entry in values.items():
        if index in _RPDO_MAPPING and 0 < subindex <= values.get((index, 0), 0):
            commanded.add((int(entry) >> 16, int(entry) >> 8 & 0xFF))
    return commanded


def _is_beyond_mapping(key: ObjectKey, values: Mapping[ObjectKey, int | float]) -> bool:
    index, subindex = key
    return any(index in block for block in MAPPING) and subindex > values.get((index, 0), 0)


def _place(node: Node, key: ObjectKey) -> str:
    variable = node.variable(*key)
    return f"0x{key[0]:04X}.{key[1]:02X} ({variable.qualname})"


def _text(key: ObjectKey, value: int | float) -> str:  # noqa: PYI041 - which of both it is decides
    """Return a value as an engineer reads it: identifiers and mapping entries in hexadecimal."""
    is_identifier = any(key[0] in block for block in _COMMUNICATION) and key[1] == 1
    is_entry = any(key[0] in block for block in MAPPING) and key[1] > 0
    if (is_identifier or is_entry) and isinstance(value, int):
        return f"0x{value:08X}"
    return f"{value:g}" if isinstance(value, float) else str(value)


# Writes to devices what a comparison found to be different.

_STORE = 0x1010
_SAVE = b"save"


class Write(NamedTuple):
    """One value that is to be written.

    Attributes:
        key: the object.
        name: its name in the EDS.
        value: the number.
        raw: the number as an SDO transfer carries it.
    """

    key: ObjectKey
    name: str
    value: int | float
    raw: bytes


class Plan(NamedTuple):
    """The writes to one node, in this order.

    Attributes:
        config: the node.
        writes: in the order that CiA 301 asks for: a PDO is disabled, changed and enabled again.
    """

    config: NodeConfig
    writes: tuple[Write, ...]


def plan_writes(
    network: Network, config: BenchConfig, differences: Iterable[Difference]
) -> list[Plan]:
    """Return the writes that correct all differences that a write can correct."""
    wrong: dict[int, dict[ObjectKey, float]] = {}
    for difference in differences:
        if difference.mend is Mend.WRITE and difference.key and difference.right is not None:
            wrong.setdefault(difference.node_id, {})[difference.key] = difference.right
    nodes = {node.node_id: node for node in config.nodes}
    return [
        Plan(nodes[node_id], tuple(_writes(network.nodes[node_id], nodes[node_id], values)))
        for node_id, values in sorted(wrong.items())
    ]


def apply(network: Network, plan: Plan, *, store: bool) -> None:
    """Write a plan to its node, which is commanded to PRE-OPERATIONAL and stays there.

    Args:
        network: the network that the node is on.
        plan: what to write.
        store: whether to have the node keep it over a power cycle (0x1010.01).
    """
    node = network.nodes[plan.config.node_id]
    network.enter_pre_operational(node.node_id)
    for write in plan.writes:
        node.download(*write.key, write.raw)
    if store:
        node.download(_STORE, 1, _SAVE)


def concise_dcf(plan: Plan) -> bytes:
    """Return a plan as a concise DCF: what an NMT master keeps in 0x1F22 (CiA 302-3)."""
    return pack_concise_dcf([ConciseEntry(*write.key, write.raw) for write in plan.writes])


def _writes(node: Node, config: NodeConfig, wrong: Mapping[ObjectKey, float]) -> list[Write]:
    writes: list[Write] = []
    pdos = sorted({pdo for key in wrong if (pdo := pdo_of(key[0])) is not None})
    for key, value in wrong.items():
        if pdo_of(key[0]) is None:
            writes.append(_write(node, key, value))
    for communication in pdos:
        writes += _pdo_writes(node, expected_values(node, config), wrong, communication)
    return writes


def _pdo_writes(
    node: Node,
    right: Mapping[ObjectKey, float],
    wrong: Mapping[ObjectKey, float],
    communication: int,
) -> list[Write]:
    """Return the dynamic mapping procedure of one PDO (CiA 301)."""
    mapping = communication + TO_MAPPING
    identifier = int(right.get((communication, 1), 0)) or node.read_integer(communication, 1)
    writes = [_write(node, (communication, 1), identifier | INVALID)]
    writes += [
        _write(node, key, value)
        for key, value in wrong.items()
        if key[0] == communication and key[1] > 1
    ]
    if any(key[0] == mapping for key in wrong):
        count = int(right[mapping, 0])
        writes.append(_write(node, (mapping, 0), 0))
        writes += [_write(node, (mapping, sub), right[mapping, sub]) for sub in range(1, count + 1)]
        writes.append(_write(node, (mapping, 0), count))
    return [*writes, _write(node, (communication, 1), identifier)]


def _write(node: Node, key: ObjectKey, value: float) -> Write:
    variable = node.variable(*key)
    return Write(key, variable.qualname, value, variable.encode_raw(value))
