"""All that a scan of a bus finds."""

from collections.abc import Iterable
from dataclasses import dataclass

from hil_bench.abilities.commissioning.discovery import NODE_IDS, Method, Sighting, discover
from hil_bench.abilities.commissioning.identity import NodeDescription, describe
from hil_bench.abilities.commissioning.listening import BusTraffic
from hil_bench.abilities.commissioning.lss import LssScan, find_unconfigured
from hil_bench.abilities.commissioning.operation import signs_of_operation
from hil_drivers import Network


@dataclass(frozen=True, slots=True)
class Survey:
    """The findings of a scan.

    Attributes:
        nodes: in the order of their node-IDs.
        unconfigured: devices that wait for a node-ID; None where nobody asked.
        traffic: on the bus while the nodes were looked for, the scan's own frames included.
        operation: signs that the bus is in operation, for which nothing was sent; empty where the
            nodes were asked.
    """

    nodes: tuple[NodeDescription, ...]
    unconfigured: LssScan | None
    traffic: BusTraffic
    operation: tuple[str, ...] = ()


def survey(
    network: Network,
    method: Method,
    *,
    node_ids: Iterable[int] = NODE_IDS,
    patience: float = 1.0,
    lss: bool = False,
    insists: bool = False,
) -> Survey:
    """Listen to a bus, then ask its nodes; one that is in operation is listened to only.

    Args:
        network: an open network.
        method: how the nodes are made to show themselves.
        node_ids: those to look for.
        patience: time to listen before the first request and after the last, and for each answer
            of LSS [s].
        lss: whether to look for devices without node-ID, too.
        insists: whether to ask a bus in operation, too.
    """
    wanted = list(node_ids)
    heard, traffic = _observed(network, Method.HEARTBEAT, wanted, patience)
    if method is not Method.HEARTBEAT or lss:
        operation = () if insists else signs_of_operation(traffic)
        if operation:
            return Survey(tuple(map(_only_heard, heard)), None, traffic, operation)
    sightings = heard
    if method is not Method.HEARTBEAT:
        sightings, traffic = _observed(network, method, wanted, patience)
        states = {seen.node_id: seen.nmt_state for seen in heard}
        found = {seen.node_id for seen in sightings}
        sightings = sorted(
            [s._replace(nmt_state=s.nmt_state or states.get(s.node_id)) for s in sightings]
            + [seen for seen in heard if seen.node_id not in found]
        )
    nodes = tuple(describe(network, sighting) for sighting in sightings)
    unconfigured = find_unconfigured(network, patience) if lss else None
    return Survey(nodes, unconfigured, traffic)


def _observed(
    network: Network, method: Method, node_ids: list[int], patience: float
) -> tuple[list[Sighting], BusTraffic]:
    """Look for nodes, and return them with the traffic meanwhile."""
    traffic = BusTraffic()
    network.observe = traffic.take
    begin = network.now()
    try:
        sightings = discover(network, method, node_ids=node_ids, patience=patience)
    finally:
        network.observe = None
    traffic.duration = network.now() - begin
    return sightings, traffic


def _only_heard(sighting: Sighting) -> NodeDescription:
    """Describe a node by its heartbeat alone."""
    state = sighting.nmt_state
    name = None if state is None else state.name
    return NodeDescription(sighting.node_id, name, clash=False, problem="not asked, only heard")
