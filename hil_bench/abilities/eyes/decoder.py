"""Reads the frames of a bus one after the other and says what each is.

The one place that does: the verbs `monitor`, `decode`, `record`, `explain` and `plot`, and the
reports of failed tests, all ask it.
"""

from collections.abc import Callable, Container, Iterable
from functools import partial
from typing import TYPE_CHECKING, Final

from hil_bench.abilities.common.identifiers import function_of
from hil_bench.abilities.eyes import frame_sights
from hil_bench.abilities.eyes.j1939_bus import J1939Reader
from hil_bench.abilities.eyes.known_ecu import KnownEcu
from hil_bench.abilities.eyes.known_node import KnownNode, PdoOwner
from hil_bench.abilities.eyes.sight import Service, Sight
from hil_bench.abilities.eyes.transfers import SdoChannel, Transfer, Way
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.nmt import ENTERED, RESTORED, NmtRequest, NmtState
from hil_bench.canopen_device.pdo_parameters import Direction
from hil_bench.frame import BUS_SHIFT, ERROR_FLAG, address_of
from hil_bench.outside.recording.channels import LoggedFrame

if TYPE_CHECKING:
    from hil_bench.abilities.eyes.pdos import Pdo

_STATE_BITS: Final = 0x7F
_NODE_IDS: Final = range(1, 128)
_LOOK: Final = 100_000_000

_Key = int
_Handler = Callable[[LoggedFrame], Sight | list[Sight]]


class Decoder:
    """Says what the frames of one or several buses are.

    It follows what it hears: an SDO download of a mapping changes how the next PDO reads, an NMT
    reset takes that back.

    Args:
        nodes: those that are known beforehand.
        ecus: the J1939 devices that are.
        others: 11-bit identifiers that are known as those of other messages; where no such node has
            them, CANopen has none.

    Attributes:
        nodes: all nodes by bus and node-ID; one that is heard for the first time comes to them.
        pdos: the PDOs of each bus and identifier, as the nodes have them now.
    """

    def __init__(
        self,
        nodes: Iterable[KnownNode] = (),
        ecus: Iterable[KnownEcu] = (),
        others: Container[int] = (),
    ) -> None:
        self.nodes = {(node.bus, node.node_id): node for node in nodes}
        self._others, self._known = others, frozenset(self.nodes)
        self.pdos: dict[_Key, list[PdoOwner]] = {}
        self._owners: dict[_Key, list[PdoOwner]] = {}
        self._channels: dict[tuple[int, int], SdoChannel] = {}
        self._routes: dict[_Key, _Handler] = {}
        self._last_frames: dict[tuple[int, int], Frame] = {}
        self._j1939 = J1939Reader(ecus)
        self._look_at = 0
        self._owned: dict[KnownNode, list[Pdo]] = {}
        self._route(self.nodes.values())

    def take(self, logged: LoggedFrame) -> list[Sight]:
        """Decode a frame; return nothing for one in the middle of an SDO transfer."""
        sights = self.expire(logged.now) if logged.now >= self._look_at else []
        frame = logged.frame
        if frame.can_id >= ERROR_FLAG and not frame.is_extended:
            return [*sights, frame_sights.error_sight(logged)]
        if frame.fd:
            return [*sights, frame_sights.fd_sight(logged)]
        if frame.is_extended:
            read = self._j1939.take(logged)
            return [*sights, *([frame_sights.extended_sight(logged)] if read is None else read)]
        key = frame.can_id | frame.bus << BUS_SHIFT
        handler = self._routes.get(key)
        if handler is None:
            handler = self._routes[key] = self._find_handler(frame)
        found = handler(logged)
        sights += found if isinstance(found, list) else (found,)
        return sights

    def expire(self, now: int) -> list[Sight]:
        """Return the transfers that nobody has continued for a second [ns]."""
        self._look_at = now + _LOOK
        return self._j1939.expire(now) + [
            self._end(self._node(*key), transfer, now, self._last_frames[key])
            for key, channel in self._channels.items()
            for transfer in channel.expire(now)
        ]

    def finish(self) -> list[Sight]:
        """Return the transfers that the end has interrupted."""
        found = self._j1939.finish()
        for key, channel in self._channels.items():
            node, frame = self._node(*key), self._last_frames[key]
            ended = channel.finish()
            found += [self._end(node, transfer, transfer.end, frame) for transfer in ended]
        return found

    def accept_late(self, node: KnownNode, transfer: Transfer) -> None:
        """Take a download as done that its client had given up when the server acknowledged it."""
        if transfer.way is Way.DOWNLOAD and node.assume(
            transfer.index, transfer.subindex, bytes(transfer.data)
        ):
            self._route((node,))

    @property
    def ecus(self) -> list[str]:
        """Names of the J1939 devices that are known beforehand."""
        return self._j1939.names

    def owners(self, frame: Frame) -> list[PdoOwner]:
        """Return the owners of a PDO: its senders, or else its receivers."""
        return self._owners.get(frame.can_id | frame.bus << BUS_SHIFT, [])

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
            for owner in (PdoOwner(node, pdo) for pdo in pdos):
                self.pdos.setdefault(owner.address, []).append(owner)
            emcy = node.identifier_of(0x1014)
            if emcy is not None:
                self._routes[address_of(emcy, node.bus)] = partial(frame_sights.emcy_sight, node)
            sync = node.identifier_of(0x1005)
            if sync is not None:
                self._routes[address_of(sync, node.bus)] = self._hear_sync
        self._owners = {}
        for key, found in self.pdos.items():
            self._routes[key] = self._hear_pdo
            senders = [owner for owner in found if owner.pdo.direction is Direction.TPDO]
            self._owners[key] = senders or found

    def _find_handler(self, frame: Frame) -> _Handler:
        """Return the handler of an identifier, by the predefined connection set."""
        name, node_id = function_of(frame.can_id)
        by_name: dict[str, _Handler] = {"NMT": self._hear_nmt, "SYNC": self._hear_sync}
        if name in by_name:
            return by_name[name]
        is_other = frame.can_id in self._others and (frame.bus, node_id) not in self._known
        if node_id is None or is_other:
            service = Service.LSS if name.startswith("LSS") else Service.OTHER
            service = Service.TIME if name == "TIME" else service
            return partial(frame_sights.plain_sight, service)
        node = self._node(frame.bus, node_id)
        if name.startswith("SDO"):
            return partial(self._hear_sdo, node, is_request=name == "SDO request")
        if name == "heartbeat":
            return partial(self._hear_heartbeat, node)
        if name == "EMCY":
            return partial(frame_sights.emcy_sight, node)
        return partial(frame_sights.unknown_pdo_sight, node, name)

    def _hear_nmt(self, logged: LoggedFrame) -> Sight:
        frame = logged.frame
        request = None if frame.is_remote else NmtRequest.parse(frame.data)
        node = None
        if request is not None:
            self._follow_command(request, frame.bus)
            if request.node_id in _NODE_IDS:
                node = self._node(frame.bus, request.node_id)
        return frame_sights.nmt_sight(node, logged)

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
        return frame_sights.sync_sight(producers, logged)

    def _hear_heartbeat(self, node: KnownNode, logged: LoggedFrame) -> Sight:
        frame = logged.frame
        if not frame.is_remote and len(frame.data) == 1:
            self._follow_state(node, frame.data[0] & _STATE_BITS)
        return frame_sights.heartbeat_sight(node, logged)

    def _follow_state(self, node: KnownNode, told: int) -> None:
        if told not in frozenset(NmtState):
            return
        node.state = NmtState(told)
        if node.state is NmtState.INITIALISING:
            node.state = NmtState.PRE_OPERATIONAL  # after its boot-up message
            node.reset(range(0x1000, 0x10000))
            self._route((node,))

    def _hear_pdo(self, logged: LoggedFrame) -> Sight:
        return frame_sights.pdo_sight(self.owners(logged.frame), logged)

    def _hear_sdo(self, node: KnownNode, logged: LoggedFrame, *, is_request: bool) -> list[Sight]:
        frame, now = logged.frame, logged.now
        if len(frame.data) != frame_sights.LENGTH_OF_SDO:
            return [frame_sights.stray_sdo_sight(node, logged)]
        key = node.bus, node.node_id
        channel = self._channels.setdefault(key, SdoChannel())
        had_current = channel.current is not None
        ended = channel.hear(frame.data, now, is_request=is_request)
        self._last_frames[key] = frame
        if not ended and not had_current and channel.current is None:
            return [frame_sights.stray_sdo_sight(node, logged)]
        return [self._end(node, transfer, now, frame) for transfer in ended]

    def _end(self, node: KnownNode, transfer: Transfer, now: int, frame: Frame) -> Sight:
        """Follow what a transfer has changed, and return what it says."""
        if transfer.is_done and node.assume(
            transfer.index, transfer.subindex, bytes(transfer.data)
        ):
            self._route((node,))
        return frame_sights.transfer_sight(node, transfer, now, frame)
