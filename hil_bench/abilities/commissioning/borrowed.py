"""The nodes of somebody else's machine: they get their settings and NMT states back."""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from hil_bench.abilities.commissioning.journal import BorrowedSetting, SettingsJournal
from hil_drivers import BusLostError, Network, NmtState, Node

STATE_TIMEOUT = 0.25
"""Longest wait for the nodes' heartbeats, which come each 0.1 s [s]."""


@dataclass(frozen=True, slots=True)
class Returned:
    """The restored settings of the nodes, after changes.

    Attributes:
        settings: those that held something else meanwhile, or still do.
        states: NMT states that the nodes were found in, by node-ID; None where a node does not say.
    """

    settings: tuple[BorrowedSetting, ...] = ()
    states: Mapping[int, NmtState | None] = field(default_factory=dict)

    @property
    def unrestored(self) -> list[BorrowedSetting]:
        """The settings that could not be restored."""
        return [setting for setting in self.settings if setting.problem]


class BorrowedNodes:
    """Nodes that are given back as they were found.

    Args:
        network: that they are on.
        nodes: the nodes.
        journal: notes what is written to them.
    """

    def __init__(
        self, network: Network, nodes: Sequence[Node], journal: SettingsJournal | None = None
    ) -> None:
        self._network = network
        self._nodes = nodes
        self._journal = journal or SettingsJournal()
        self._states: dict[int, NmtState | None] = {}
        for node in nodes:
            self._journal.watch(node)

    def start(self, since: float) -> None:
        """Command all nodes to OPERATIONAL, and note in which NMT states they are before.

        Args:
            since: when their heartbeats were switched on [s].
        """
        nodes, network = self._nodes, self._network
        network.wait_for(lambda: all(node.heard_at > since for node in nodes), STATE_TIMEOUT)
        self._states = {
            node.node_id: node.nmt_state if node.heard_at > since else None for node in nodes
        }
        for node in nodes:
            network.start_node(node.node_id)

    def end(self) -> None:
        """Take what is written from now on for the way back."""
        self._journal.close()

    def give_back(self) -> Returned:
        """Restore settings and NMT states as far as the nodes answer; never raise.

        A node that was OPERATIONAL, or does not say what it was, is left OPERATIONAL.
        """
        self._journal.restore(self._network)
        with contextlib.suppress(BusLostError, KeyboardInterrupt):
            for node_id, state in self._states.items():
                if state is NmtState.PRE_OPERATIONAL:
                    self._network.enter_pre_operational(node_id)
        return Returned(tuple(self._journal.changed), self._states)
