"""Writes to devices what a comparison found to be different."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from hil_bench.abilities.commissioning.comparison import (
    Difference,
    Mend,
    ObjectKey,
    expected_values,
)
from hil_bench.bench.configuration import BenchConfig, NodeConfig
from hil_drivers import Network, Node
from hil_drivers.concise_dcf import INVALID, TO_MAPPING, ConciseEntry, pack_concise_dcf, pdo_of

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
