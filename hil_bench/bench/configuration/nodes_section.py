"""All that ``[nodes]`` says: the nodes with their chains, bindings and scripts."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from hil_bench.bench.configuration.axes import AxesSection
from hil_bench.bench.configuration.bindings import build_bindings, read_bindings
from hil_bench.bench.configuration.buses import BusesSection
from hil_bench.bench.configuration.nodes import (
    Bindings,
    build_node_config,
    check_nodes,
    read_nodes,
    resolve_nodes,
)
from hil_bench.bench.configuration.peers import PeerSections, drives_of, places_of
from hil_bench.bench.configuration.scripts import read_scripts
from hil_bench.config.document import Document
from hil_bench.config.settings import Problems, Settings
from hil_bench.kinds.chains import check_chains


class Whole(NamedTuple):
    """The sections of a whole bench, for one that is about all of it.

    Attributes:
        axes: of the axes, with the supplies that they share.
        buses: of the buses.
        nodes: of the CANopen nodes.
        peers: of the devices beside them.
        given: what the command line adds to tables, by their names.
    """

    axes: AxesSection
    buses: BusesSection
    nodes: "NodesSection"
    peers: PeerSections
    given: Mapping[str, Any]


class NodesSection:
    """The nodes of a bench, on its buses and at its axes.

    Args:
        document: the file.
        buses: that they are on.
        axes: that they belong to.
        peers: the devices beside them.
        base: the folder that files are named from.
        problems: where problems are noted.

    Attributes:
        nodes: the table of each by its name.
        bindings: the objects of each that are bound to a plant; known once it is resolved.
    """

    def __init__(
        self,
        document: Document,
        buses: BusesSection,
        axes: AxesSection,
        peers: PeerSections,
        base: Path,
        problems: Problems,
    ) -> None:
        self.nodes, self._chains = read_nodes(document, axes.axes, problems, has_others=bool(peers))
        self.bindings: Bindings = {}
        self._buses, self._axes, self._base, self._problems = buses, axes.axes, base, problems
        self._given = read_bindings(self.nodes, self._axes, problems)
        self._scripts = read_scripts(self.nodes, problems)
        self._peers = peers
        if not self.nodes and not any(each.is_given for each in peers.values()):
            problems.add(problems.place("nodes"), "the bench has none; give one as [nodes.NAME]")

    def resolve(self) -> None:
        """Find axes, files and bindings, and note what clashes."""
        nodes, axes, problems = self.nodes, self._axes, self._problems
        resolve_nodes(nodes, axes, self._base, problems)
        self.bindings = build_bindings(self._given, nodes, axes, problems)
        check_chains(self._chains, problems)
        self._buses.check_nodes(nodes, places_of(self._peers))
        check_nodes(nodes, axes, self.bindings, drives_of(self._peers), problems)
        for table, section in self._peers.items():
            for name in nodes.keys() & section.buses.keys():
                right = f"[nodes.{name}] has that name; give each device its own"
                problems.add(problems.place(f"{table}.{name}"), right)

    def build(self) -> dict[str, Any]:
        """Return the records of the nodes."""
        built = (
            build_node_config(
                name,
                node,
                self.bindings[name],
                self._scripts[name],
                self._chains.get(name),
                self._problems,
            )
            for name, node in self.nodes.items()
        )
        return {"nodes": tuple(built)}

    def tables(self) -> Iterable[Settings]:
        """Return the table of each node, and that of its measuring chain."""
        return (
            table
            for name, node in self.nodes.items()
            for table in (node, self._chains.get(name, {}))
        )
