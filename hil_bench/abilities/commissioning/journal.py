"""The journal of what was changed in devices, and the values borrowed until the end."""

import contextlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import Self

from hil_bench.abilities.commissioning.comparison import ObjectKey
from hil_bench.errors import ConfigError, about_file
from hil_drivers import (
    BusLostError,
    DriverError,
    DriverTimeoutError,
    Network,
    NmtState,
    Node,
    SdoAbortError,
)
from hil_drivers.node import object_name

# The journal of writes to the nodes of somebody else's machine, and their restoration.
#
# Before the first write to an object the journal reads what it held, and notes it in a file,
# where a process that is killed leaves it behind. `restore` writes back what differs.

_PDOS = (range(0x1400, 0x1600), range(0x1800, 0x1A00))
_COB_ID = 1
_INVALID = 1 << 31
_BEGIN = b'{"node": '
_LONGEST_VALUE = 64
"""Bytes of an object that is a setting; a longer one is a program or a log."""


@dataclass(slots=True)
class BorrowedSetting:
    """One object that was written.

    Attributes:
        node_id: of the node.
        key: the object.
        name: by the EDS; empty without one.
        before: what it held before.
        during: what was written last before the end.
        problem: why it could not be restored; empty where it was.
    """

    node_id: int
    key: ObjectKey
    name: str
    before: bytes
    during: bytes
    problem: str = ""

    @property
    def has_changed(self) -> bool:
        """Return True if it held something else meanwhile."""
        return self.before != self.during

    def text(self, raw: bytes) -> str:
        """Return a value of the object for people."""
        number = int.from_bytes(raw, "little")
        is_identifier = self.key[1] == _COB_ID and any(self.key[0] in block for block in _PDOS)
        if len(raw) > 4:
            return f"0x{raw[::-1].hex().upper()}"
        return f"0x{number:08X}" if is_identifier or number > 0xFFFF else str(number)

    def __str__(self) -> str:
        name = f" ({self.name})" if self.name else ""
        return f"{object_name(*self.key)}{name}"


class SettingsJournal:
    """The settings that were changed.

    Args:
        path: where they are kept until they are restored; None for nowhere.

    Attributes:
        settings: in the order of their first writes.
        path: as passed in.
    """

    def __init__(self, path: Path | None = None) -> None:
        self.path = path
        self.settings: list[BorrowedSetting] = []
        self._known: dict[tuple[int, ObjectKey], BorrowedSetting] = {}
        self._is_closed = False

    @classmethod
    def read(cls, path: Path) -> Self:
        """Return the journal that another process left behind.

        A last line without its end is of a setting that has not been changed: it stood before that.

        Raises:
            ConfigError: the file cannot be read, or is no journal.
        """
        journal = cls(path)
        with about_file(path, what="cannot be read"):
            *lines, torn = path.read_bytes().split(b"\n")
        if torn and not (torn.startswith(_BEGIN) and not torn.endswith(b"}")):
            lines.append(torn)
        try:
            for line in lines:
                journal._add(_parse(json.loads(line)))
        except (ValueError, KeyError, TypeError):
            raise ConfigError(
                f"{path}: is no journal of settings; each line of one names node, object and value"
            ) from None
        return journal

    def watch(self, node: Node) -> None:
        """Note what is written to a node from now on."""

        def note(index: int, subindex: int, raw: bytes) -> None:
            self._note(node, (index, subindex), raw)

        node.before_download = note

    def close(self) -> None:
        """Note nothing more: what is written from now on is the end of it."""
        self._is_closed = True

    def restore(self, network: Network) -> None:
        """Write back what the objects held before, as far as the nodes answer; never raise.

        An interruption ends it, and what is not restored then says so. With everything restored
        the file is removed.
        """
        self.close()
        by_node = groupby(
            sorted(self.settings, key=lambda setting: setting.node_id),
            key=lambda setting: setting.node_id,
        )
        for setting in self.settings:
            setting.problem = "interrupted"
        try:
            for node_id, settings in by_node:
                _restore_node(network.add_node(node_id, _eds_of(network, node_id)), list(settings))
        except KeyboardInterrupt:
            pass
        if self.path is not None and not self.unrestored:
            self.path.unlink(missing_ok=True)

    @property
    def changed(self) -> list[BorrowedSetting]:
        """The settings that held something else meanwhile, or still do."""
        return [setting for setting in self.settings if setting.has_changed or setting.problem]

    @property
    def unrestored(self) -> list[BorrowedSetting]:
        """The settings that could not be restored."""
        return [setting for setting in self.settings if setting.problem]

    def _note(self, node: Node, key: ObjectKey, raw: bytes) -> None:
        if self._is_closed:
            return
        known = self._known.get((node.node_id, key))
        if known is not None:
            known.during = raw
            return
        try:
            before = node.upload(*key)
        except SdoAbortError:
            return  # it can be written only, so it is a command
        name = node.variable(*key).qualname if node.has(*key) else ""
        setting = BorrowedSetting(node.node_id, key, name, before, raw)
        self._keep(setting)
        self._add(setting)

    def _add(self, setting: BorrowedSetting) -> None:
        self._known[setting.node_id, setting.key] = setting
        self.settings.append(setting)

    def _keep(self, setting: BorrowedSetting) -> None:
        """Add a setting to the file before it is changed."""
        if self.path is None:
            return
        index, subindex = setting.key
        line = {
            "node": setting.node_id,
            "object": f"0x{index:04X}.{subindex:02X}",
            "name": setting.name,
            "before": setting.before.hex(),
            "during": setting.during.hex(),
        }
        with about_file(self.path), self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")
            file.flush()
            os.fsync(file.fileno())


def _parse(line: dict[str, object]) -> BorrowedSetting:
    """Return the setting of one line of a journal.

    Raises:
        ValueError: it is none.
    """
    index, _, subindex = str(line["object"]).partition(".")
    node_id, key = int(str(line["node"])), (int(index, 16), int(subindex, 16))
    before, during = (bytes.fromhex(str(line[name])) for name in ("before", "during"))
    if not 1 <= node_id <= 127 or not 0 <= key[0] <= 0xFFFF or not 0 <= key[1] <= 0xFF:
        raise ValueError
    if not 1 <= len(before) <= _LONGEST_VALUE:
        raise ValueError
    return BorrowedSetting(node_id, key, str(line["name"]), before, during)


def _eds_of(network: Network, node_id: int) -> Path | None:
    known = network.nodes.get(node_id)
    return None if known is None else known.eds


def _restore_node(node: Node, settings: Sequence[BorrowedSetting]) -> None:
    node.before_download = None
    gone = ""
    for group in _groups(settings):
        problem = gone
        try:
            if not gone:
                _restore_group(node, group)
        except SdoAbortError as error:
            problem = str(error)
        except DriverTimeoutError:
            problem = gone = f"{node} does not answer"
        except DriverError as error:
            problem = gone = str(error)
        if problem:
            for setting in group:
                setting.problem = problem


def _groups(settings: Iterable[BorrowedSetting]) -> Iterator[list[BorrowedSetting]]:
    """Yield the settings of a PDO together, all others by themselves."""
    ordered = sorted(settings, key=lambda setting: setting.key)
    for (_, _), group in groupby(ordered, key=lambda setting: _group_key(setting.key)):
        yield list(group)


def _group_key(key: ObjectKey) -> tuple[int, int]:
    is_pdo = any(key[0] in block for block in _PDOS)
    return (key[0], 0) if is_pdo else key


def _restore_group(node: Node, group: Sequence[BorrowedSetting]) -> None:
    """Write back what differs; a PDO is disabled meanwhile, as CiA 301 has it for 0x1800."""
    for setting in group:
        setting.problem = ""
    wrong = [setting for setting in group if node.upload(*setting.key) != setting.before]
    index = group[0].key[0]
    if not wrong or not any(index in block for block in _PDOS):
        _write_back(node, wrong)
        return
    identifier = next((s.before for s in group if s.key[1] == _COB_ID), None)
    if identifier is None:
        identifier = node.upload(index, _COB_ID)
    disabled = int.from_bytes(identifier, "little") | _INVALID
    node.download(index, _COB_ID, disabled.to_bytes(4, "little"))
    _write_back(node, [setting for setting in wrong if setting.key[1] != _COB_ID])
    node.download(index, _COB_ID, identifier)


def _write_back(node: Node, settings: Iterable[BorrowedSetting]) -> None:
    for setting in settings:
        try:
            node.download(*setting.key, setting.before)
        except SdoAbortError as error:
            setting.problem = str(error)


# The nodes of somebody else's machine: they get their settings and NMT states back.

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
