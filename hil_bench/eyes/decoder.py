"""Reads the frames of a bus one after the other and says what each is.

The one place that does: the verbs `monitor`, `decode`, `record`, `explain` and `plot`, and the
reports of failed tests, all ask it.
"""

from collections.abc import Callable, Iterable
from functools import partial
from typing import Final, NamedTuple

from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.nmt import ENTERED, RESTORED, NmtRequest, NmtState
from hil_bench.canopen_device.pdo_mapping import Direction
from hil_bench.eyes.codes import abort_text, nmt_text
from hil_bench.eyes.frame_words import emcy_words, meaning_of
from hil_bench.eyes.identifiers import function_of
from hil_bench.eyes.known_node import KnownNode
from hil_bench.eyes.pdos import Pdo
from hil_bench.eyes.sight import Service, Sight
from hil_bench.eyes.transfers import SdoChannel, Transfer, Way
from hil_bench.frame import BUS_SHIFT
from hil_bench.outside.recording.logged_frame import LoggedFrame

_STATE_BITS: Final = 0x7F
_NODE_IDS: Final = range(1, 128)
_LOOK: Final = 100_000_000
_LENGTH_OF_SDO: Final = 8

_Key = int
_Handler = Callable[[LoggedFrame], Sight | None]


class PdoOwner(NamedTuple):
    """A PDO and the node that sends or receives it."""

    node: KnownNode
    pdo: Pdo


class Decoder:
    """Says what the frames of one or several buses are.

    It follows what it hears: an SDO download of a mapping changes how the next PDO reads, an NMT
    reset takes that back.

    Args:
        nodes: those that are known beforehand.

    Attributes:
        nodes: all nodes by bus and node-ID; one that is heard for the first time comes to them.
        pdos: the PDOs of each bus and identifier, as the nodes have them now.
    """

    def __init__(self, nodes: Iterable[KnownNode] = ()) -> None:
        self.nodes = {(node.bus, node.node_id): node for node in nodes}
        self.pdos: dict[_Key, list[PdoOwner]] = {}
        self._channels: dict[tuple[int, int], SdoChannel] = {}
        self._routes: dict[_Key, _Handler] = {}
        self._last_frames: dict[tuple[int, int], Frame] = {}
        self._look_at = 0
        self._owned: dict[KnownNode, list[Pdo]] = {}
        self._route(self.nodes.values())

    def take(self, logged: LoggedFrame) -> list[Sight]:
        """Return what a frame says; nothing for one in the middle of an SDO transfer."""
        sights = self.expire(logged.now) if logged.now >= self._look_at else []
        frame = logged.frame
        if frame.is_extended:
            text = f"not CANopen, 29-bit identifier 0x{frame.can_id:08X}"
            sights.append(Sight(logged.now, frame, Service.OTHER, "29-bit", words=text))
            return sights
        key = frame.can_id | frame.bus << BUS_SHIFT
        handler = self._routes.get(key)
        if handler is None:
            handler = self._routes[key] = self._find_handler(frame)
        if handler == self._hear_sdo:
            sights += self._hear_transfers(logged)
        elif (sight := handler(logged)) is not None:
            sights.append(sight)
        return sights

    def expire(self, now: int) -> list[Sight]:
        """Return the SDO transfers that nobody has continued for a second [ns]."""
        self._look_at = now + _LOOK
        return [
            self._tell_transfer(self._node(*key), transfer, now, self._last_frames[key])
            for key, channel in self._channels.items()
            if (transfer := channel.expire(now)) is not None
        ]

    def finish(self) -> list[Sight]:
        """Return the SDO transfers that the end has interrupted."""
        found = []
        for key, channel in self._channels.items():
            transfer, channel.current = channel.current, None
            if transfer is not None:
                node, frame = self._node(*key), self._last_frames[key]
                found.append(self._tell_transfer(node, transfer, transfer.end, frame))
        return found

    def owners(self, frame: Frame) -> list[PdoOwner]:
        """Return whose PDO a frame is: who sends it, or else who receives it."""
        found = self.pdos.get(frame.can_id | frame.bus << BUS_SHIFT, [])
        senders = [owner for owner in found if owner.pdo.direction is Direction.TPDO]
        return senders or found

    def _node(self, bus: int, node_id: int) -> KnownNode:
        node = self.nodes.get((bus, node_id))
        if node is None:
            node = self.nodes[bus, node_id] = KnownNode(node_id, bus=bus)
        return node

    def _route(self, changed: Iterable[KnownNode]) -> None:
        """Find the PDOs, and who is behind the identifiers that nodes may choose.

        Args:
            changed: the nodes whose objects have changed; the PDOs of the others stay.
        """
        self._owned.update({node: node.pdos() for node in changed})
        self.pdos = {}
        self._routes = {}
        for node, pdos in self._owned.items():
            shift = node.bus << BUS_SHIFT
            for pdo in pdos:
                self.pdos.setdefault(pdo.can_id | shift, []).append(PdoOwner(node, pdo))
            emcy = node.identifier_of(0x1014)
            if emcy is not None:
                self._routes[emcy | shift] = partial(self._hear_emcy, node)
            sync = node.identifier_of(0x1005)
            if sync is not None:
                self._routes[sync | shift] = self._hear_sync
        for key in self.pdos:
            self._routes[key] = self._hear_pdo

    def _find_handler(self, frame: Frame) -> _Handler:
        """Return who reads an identifier, by the predefined connection set."""
        name, node_id = function_of(frame.can_id)
        by_name: dict[str, _Handler] = {"NMT": self._hear_nmt, "SYNC": self._hear_sync}
        if name in by_name:
            return by_name[name]
        if node_id is None:
            service = Service.LSS if name.startswith("LSS") else Service.OTHER
            service = Service.TIME if name == "TIME" else service
            return partial(self._hear_plain, service)
        if name.startswith("SDO"):
            return self._hear_sdo
        node = self._node(frame.bus, node_id)
        if name == "heartbeat":
            return partial(self._hear_heartbeat, node)
        if name == "EMCY":
            return partial(self._hear_emcy, node)
        return partial(self._hear_unknown_pdo, node, name)

    def _hear_plain(self, service: Service, logged: LoggedFrame) -> Sight:
        frame = logged.frame
        name = function_of(frame.can_id).name
        words = _remote_or(frame, meaning_of(frame.can_id, frame.data) or _digits(frame))
        return Sight(logged.now, frame, service, name, words=words)

    def _hear_nmt(self, logged: LoggedFrame) -> Sight:
        frame = logged.frame
        words = nmt_text(frame.data)
        problem = "" if words and not frame.is_remote else "is no NMT message of 2 bytes"
        request = None if frame.is_remote else NmtRequest.parse(frame.data)
        name, node_id = "", None
        if request is not None:
            self._follow_command(request, frame.bus)
            if request.node_id in _NODE_IDS:
                node_id = request.node_id
                name = self._node(frame.bus, node_id).name
        return Sight(logged.now, frame, Service.NMT, "NMT", name, node_id, words, problem=problem)

    def _follow_command(self, request: NmtRequest, bus: int) -> None:
        addressed = [
            node
            for node in self.nodes.values()
            if node.bus == bus and request.addresses(node.node_id)
        ]
        for node in addressed:
            node.state = ENTERED[request.command]
            if request.command in RESTORED:
                node.reset(RESTORED[request.command])
        if request.command in RESTORED:
            self._route(addressed)

    def _hear_sync(self, logged: LoggedFrame) -> Sight:
        frame = logged.frame
        producers = [
            node
            for node in self.nodes.values()
            if node.bus == frame.bus
            and node.produces_sync
            and node.identifier_of(0x1005) == frame.can_id
        ]
        who = producers[0] if len(producers) == 1 else None
        words = f"counter {frame.data[0]}" if len(frame.data) == 1 else ""
        problem = f"{len(frame.data)} bytes, 0 or 1 are right" if len(frame.data) > 1 else ""
        return Sight(
            logged.now,
            frame,
            Service.SYNC,
            "SYNC",
            " or ".join(node.name for node in producers) or "a master",
            None if who is None else who.node_id,
            _remote_or(frame, words),
            problem=problem,
        )

    def _hear_emcy(self, node: KnownNode, logged: LoggedFrame) -> Sight:
        frame = logged.frame
        is_right = len(frame.data) == 8
        return Sight(
            logged.now,
            frame,
            Service.EMCY,
            "EMCY",
            node.name,
            node.node_id,
            _remote_or(frame, emcy_words(frame.data) if is_right else _digits(frame)),
            problem="" if is_right or frame.is_remote else f"{len(frame.data)} bytes, 8 are right",
        )

    def _hear_heartbeat(self, node: KnownNode, logged: LoggedFrame) -> Sight:
        frame = logged.frame
        if frame.is_remote:
            words, problem = "node guarding request", ""
        elif len(frame.data) != 1:
            words, problem = _digits(frame), f"{len(frame.data)} bytes, 1 is right"
        else:
            words, problem = meaning_of(frame.can_id, frame.data), ""
            self._follow_state(node, frame.data[0] & _STATE_BITS)
        return Sight(
            logged.now,
            frame,
            Service.HEARTBEAT,
            "boot-up" if words == "boot-up" else "heartbeat",
            node.name,
            node.node_id,
            "" if words == "boot-up" else words,
            problem=problem,
        )

    def _follow_state(self, node: KnownNode, told: int) -> None:
        if told not in frozenset(NmtState):
            return
        node.state = NmtState(told)
        if node.state is NmtState.INITIALISING:
            node.state = NmtState.PRE_OPERATIONAL  # after its boot-up message
            node.reset(range(0x1000, 0x10000))
            self._route((node,))

    def _hear_pdo(self, logged: LoggedFrame) -> Sight:
        frame = logged.frame
        owners = self.owners(frame)
        node, pdo = owners[0]
        name, node_id = node.name, node.node_id
        if len(owners) > 1:
            name = ", ".join(owner.node.name for owner in owners)
        if frame.is_remote:
            head = logged.now, frame, Service.PDO, pdo.name, name, node_id
            return Sight(*head, "remote request")
        readings, problem = pdo.read(frame.data), pdo.problem(frame.data)
        words = "" if readings else _digits(frame)
        return Sight(
            logged.now, frame, Service.PDO, pdo.name, name, node_id, words, readings, problem
        )

    def _hear_unknown_pdo(self, node: KnownNode, name: str, logged: LoggedFrame) -> Sight:
        frame = logged.frame
        problem = "its EDS has no such PDO" if node.has_eds and not frame.is_remote else ""
        words = _remote_or(frame, _digits(frame))
        return Sight(
            logged.now,
            frame,
            Service.PDO,
            name,
            node.name,
            node.node_id,
            words,
            problem=problem,
        )

    def _hear_sdo(self, logged: LoggedFrame) -> None:
        """Stand for `_hear_transfers`, which may say more than one thing."""

    def _hear_transfers(self, logged: LoggedFrame) -> list[Sight]:
        frame, now = logged.frame, logged.now
        function = function_of(frame.can_id)
        node = self._node(frame.bus, function.node_id or 0)
        key = node.bus, node.node_id
        if len(frame.data) != _LENGTH_OF_SDO:
            problem = "" if frame.is_remote else f"{len(frame.data)} bytes, 8 are right"
            words = _remote_or(frame, _digits(frame))
            head = now, frame, Service.SDO, function.name, node.name, node.node_id
            return [Sight(*head, words, problem=problem)]
        channel = self._channels.setdefault(key, SdoChannel())
        had_current = channel.current is not None
        is_request = function.name == "SDO request"
        ended = channel.hear(frame.data, now, is_request=is_request)
        self._last_frames[key] = frame
        if not ended and not had_current and channel.current is None:
            words = f"{meaning_of(frame.can_id, frame.data)}, of no transfer that was seen to begin"
            head = now, frame, Service.SDO, function.name, node.name, node.node_id
            return [Sight(*head, words)]
        return [self._tell_transfer(node, transfer, now, frame) for transfer in ended]

    def _tell_transfer(self, node: KnownNode, transfer: Transfer, now: int, frame: Frame) -> Sight:
        raw = bytes(transfer.data)
        reader = node.reader(transfer.index, transfer.subindex)
        what = f"{transfer.way.value} {transfer.place}"
        what += f" {reader.name}" if reader.name else ""
        duration = f"{(transfer.end - transfer.begin) * 1e-6:.3g} ms"
        problem = ""
        if transfer.is_done:
            problem = reader.why_not(raw)
            if transfer.is_short:
                problem = f"{len(raw)} bytes came, {transfer.announced} were announced"
            if node.assume(transfer.index, transfer.subindex, raw):
                self._route((node,))
                reader = node.reader(transfer.index, transfer.subindex)
            sign = "=" if transfer.way is Way.UPLOAD else ":="
            words = f"{what} {sign} {reader.read(raw).text}, {duration}"
        elif transfer.abort is not None:
            by = " by the client" if transfer.is_aborted_by_client else ""
            problem = f"aborted{by}, 0x{transfer.abort:08X}, {abort_text(transfer.abort)}"
            words = f"{what}, {duration}"
        else:
            problem = "not continued" if transfer.is_answered else "not answered"
            words = what
        return Sight(
            now,
            frame,
            Service.SDO,
            "SDO",
            node.name,
            node.node_id,
            words,
            problem=problem,
            transfer=transfer,
        )


def _digits(frame: Frame) -> str:
    return f"[{frame.data.hex(' ').upper()}]"


def _remote_or(frame: Frame, words: str) -> str:
    return "remote request" if frame.is_remote else words
