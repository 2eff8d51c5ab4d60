"""All that ``[nodes]`` says: nodes, chains, bindings, scripts; warnings about their EDS files."""

import logging
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from hil_bench.bench.configuration.axes import AxesSection
from hil_bench.bench.configuration.bindings import build_bindings, read_bindings, read_scripts
from hil_bench.bench.configuration.buses import BusesSection
from hil_bench.bench.configuration.nodes import (
    Bindings,
    PeerSections,
    build_node_config,
    check_nodes,
    drives_of,
    places_of,
    read_nodes,
    resolve_nodes,
)
from hil_bench.canopen_device.eds import commissioned_node_id, load_eds
from hil_bench.canopen_device.eds_document import EdsFinding, Severity
from hil_bench.canopen_device.nmt import UNCONFIGURED
from hil_bench.config.document import Document
from hil_bench.config.settings import Problems, Settings
from hil_bench.devices.kinds.bindings import check_chains
from hil_bench.devices.kinds.registry import KINDS
from hil_bench.errors import EdsError


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


# Warnings about the EDS files of a bench, each file once.

logger = logging.getLogger(__name__)

_OURS: Final = frozenset(kind.eds for kind in KINDS.built_in.values())
_MOST_SHOWN: Final = 10


def warn_of_nodes(nodes: Mapping[str, Settings]) -> None:
    """Log what is wrong in the EDS files of nodes."""
    devices = [(Path(node["eds"].value), node["node_id"].value) for node in nodes.values()]
    found = find_in_eds(devices)
    for path, node_id in devices:
        if path in found:
            warn_of_commissioning(path, node_id)
    for path, findings in found.items():
        warn_of_findings(path, findings)


def find_in_eds(devices: Iterable[tuple[Path, int]]) -> dict[Path, list[EdsFinding]]:
    """Return the findings on the EDS files of devices, but for those of this package.

    A file that is no EDS is left to whoever makes the device.

    Args:
        devices: the file and the node-ID of each; what is wrong may depend on both.
    """
    found: dict[Path, list[EdsFinding]] = {}
    for path, node_id in devices:
        if path in _OURS:
            continue
        try:
            findings = load_eds(path, node_id).findings
        except EdsError:
            continue
        of_file = found.setdefault(path, [])
        known = {(each.line, each.section) for each in of_file}
        of_file += [each for each in findings if (each.line, each.section) not in known]
    return found


def warn_of_commissioning(path: Path, node_id: int) -> None:
    """Log that a DCF was made for another node-ID, whose identifiers it then has."""
    made_for = commissioned_node_id(path)
    if made_for not in {None, node_id} and node_id != UNCONFIGURED:
        text = "%s: was made for node-ID %d, and is read for %d; its identifiers may be those of %d"
        logger.warning(text, path, made_for, node_id, made_for)


def warn_of_findings(path: Path, findings: Iterable[EdsFinding]) -> None:
    """Log what is wrong in an EDS file, a line each, errors first, the first ten of many."""
    ordered = sorted(findings, key=lambda finding: finding.severity is not Severity.ERROR)
    for finding in ordered[:_MOST_SHOWN]:
        logger.warning("%s:%s", path, finding)
    if len(ordered) > _MOST_SHOWN:
        more = len(ordered) - _MOST_SHOWN
        logger.warning("%s: and %d more; hil-bench check-eds %s shows all", path, more, path)
