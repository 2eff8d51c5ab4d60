"""All that a scan of a bus finds."""

from collections.abc import Iterable
from dataclasses import dataclass

from hil_bench.abilities.commissioning.discovery import NODE_IDS, Method, discover
from hil_bench.abilities.commissioning.identity import NodeDescription, describe
from hil_bench.abilities.commissioning.listening import BusTraffic
from hil_bench.abilities.commissioning.lss import LssScan, find_unconfigured
from hil_drivers import Network


@dataclass(frozen=True, slots=True)
class Survey:
    """The findings of a scan.

    Attributes:
        nodes: in the order of their node-IDs.
        unconfigured: devices that wait for a node-ID; None where nobody asked.
        traffic: on the bus while the nodes were looked for, the scan's own frames included.
    """

    nodes: tuple[NodeDescription, ...]
    unconfigured: LssScan | None
    traffic: BusTraffic


def survey(
    network: Network,
    method: Method,
    *,
    node_ids: Iterable[int] = NODE_IDS,
    patience: float = 1.0,
    lss: bool = False,
) -> Survey:
    """Scan a bus.

    Args:
        network: an open network.
        method: how the nodes are made to show themselves.
        node_ids: those to look for.
        patience: time to listen after the last request, and for each answer of LSS [s].
        lss: whether to look for devices without node-ID, too.
    """
    traffic = BusTraffic()
    network.observe = traffic.take
    begin = network.now()
    sightings = discover(network, method, node_ids=node_ids, patience=patience)
    network.observe = None
    traffic.duration = network.now() - begin
    nodes = tuple(describe(network, sighting) for sighting in sightings)
    unconfigured = find_unconfigured(network, patience) if lss else None
    return Survey(nodes, unconfigured, traffic)
