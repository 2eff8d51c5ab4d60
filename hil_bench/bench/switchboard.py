"""Connects the nodes of a bench with each other and with its buses.

A frame from a bus, or from a node of the bench, goes to every node that listens to its COB-ID on
its bus. A frame that a node sends goes out to the node's bus, and in the next round to the other
nodes of the bench, as on a wire. Ways, such as a line with a fault, lie between a node and its bus.

One round is `receive`, then `send`; a tick of the bench is one, and so is what it serves between
two ticks.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

from hil_bench.canopen_device.agenda import Agenda
from hil_bench.canopen_device.frame import Emit, Frame, Handler, Routes, make_frame
from hil_bench.canopen_device.node import Node
from hil_bench.frame import BUS_SHIFT, address_of


class Way(Protocol):
    """Something between a device and its bus."""

    @property
    def may_delay(self) -> bool:
        """True if it may hold frames back; only then its `deliver` and `release` are called."""

    def sender(self, emit: Emit) -> Emit:
        """Return a callable that sends the device's frames; `emit` is nearer to the bus."""

    def guard(self, handle: Handler) -> Handler:
        """Wrap a handler of the device so that received frames pass the way first."""

    def deliver(self, now: int) -> None:
        """Begin a round at `now` [ns]: hand the device the frames that were late until then."""

    def release(self, emit: Emit) -> None:
        """Emit the frames of the device that were late until now."""


Ways = Mapping[Any, Way]
"""The ways of some devices, by the devices."""


@dataclass(frozen=True, slots=True, eq=False)
class Port:
    """The place where a node is plugged in.

    Attributes:
        node: that node.
        emit: takes the frames that the node sends.
        release: sends the late frames whose time has come; None where none may be late.
    """

    node: Node
    emit: Emit
    release: Callable[[], None] | None


class Switchboard:
    """All nodes of a bench, each on its bus.

    Args:
        buses: the number of the bus of each node.
        agenda: the one that all these nodes bring forward.

    Attributes:
        nodes: all of them.
        ports: those of all nodes, in the same order.
        routes: every COB-ID that some node listens to, by `address_of`; a new object after a
            change.
        unrouted: the number of received frames that no node listens to.
        emit: takes a frame that is sent in this round, from no node.
        knows_senders: whether somebody else knows which received frames are from elsewhere, and
            calls `count_foreign` with them.
    """

    def __init__(self, buses: Mapping[Node, int], agenda: Agenda) -> None:
        self.knows_senders = False
        self.nodes = tuple(buses)
        self.unrouted = 0
        self._buses = dict(buses)
        self._agenda = agenda
        self._layers: dict[object, Ways] = {}
        self._heard: list[Frame] = []
        self._sent: list[Frame] = []
        self.emit: Emit = self._sent.append
        self._synchronised_at: int | None = None
        self._extended: dict[int, Handler] = {}
        self._preludes: list[Callable[[int], None]] = []
        self._plugs: list[Callable[[], None]] = []
        self._plug_in()

    @property
    def overheard(self) -> Collection[int]:
        """The identifiers, by `address_of`, that a node other than their sender listens to."""
        return self._overheard

    def start(self, now: int) -> None:
        """Power all nodes on at `now` [ns]; each boots up in the first round."""
        for node in self.nodes:
            node.start(now)
        self._follow_routes(self.ports)

    def host(
        self, bus: int, take: Handler, begin: Callable[[int], None], plug: Callable[[], None]
    ) -> None:
        """Let others than CANopen nodes have the frames with a 29-bit identifier.

        Args:
            bus: its number.
            take: takes such a frame of this bus.
            begin: called at the beginning of each round [ns].
            plug: called now, and whenever a way between a device and a bus comes in.
        """
        self._extended[bus] = take
        self._preludes.append(begin)
        self._plugs.append(plug)
        self._plug_in()

    def lay(self, owner: object, ways: Ways) -> None:
        """Let the frames of these devices go by ways, in place of those that the owner laid last.

        The ways of who came first are nearest to the bus.
        """
        before = self._layers.get(owner, {})
        self._layers[owner] = ways
        if ways is not before and (ways or before):
            self._plug_in()

    def connect(self, device: object, emit: Emit) -> tuple[Emit, Callable[[], None] | None]:
        """Put the ways of a device between it and what takes its frames at the bus.

        Returns:
            The callable that sends a frame, and the one that sends the late frames whose time has
            come; None where none may be late.
        """
        release: Callable[[], None] | None = None
        for way in self._ways_of(device):
            if way.may_delay:
                release = partial(_release, way, emit, release)
            emit = way.sender(emit)
        return emit, release

    def guard(self, device: object, handle: Handler) -> Handler:
        """Wrap a handler of a device so that frames from the bus pass its ways first."""
        for way in self._ways_of(device)[::-1]:
            handle = way.guard(handle)
        return handle

    def _ways_of(self, device: object) -> list[Way]:
        """Return the ways between a bus and a device, from the bus on."""
        return [ways[device] for ways in self._layers.values() if device in ways]

    @property
    def hears_all(self) -> bool:
        """True if frames are for devices here whose identifiers nobody can list."""
        return bool(self._extended)

    def is_timeless(self, frame: Frame) -> bool:
        """Return True if a frame may be served between two ticks: SDO requests, unheard frames.

        None may while a frame that one of our nodes has sent waits for the next round to be heard
        by another one, since nothing is to overtake it.
        """
        if self._heard:
            return False
        can_id, _, _, is_extended, bus, fd = frame
        if is_extended or fd:
            return fd != 0 or bus not in self._extended
        address = can_id | bus << BUS_SHIFT
        return address in self._timeless or address not in self.routes

    def concerned(self, frames: Sequence[Frame]) -> Sequence[Port]:
        """Return the ports of the nodes that may have something to do after these frames."""
        if len(frames) != 1 or self._heard or self._laid:
            return self.ports
        can_id, _, _, is_extended, bus, fd = frames[0]
        return () if is_extended or fd else self._listeners.get(can_id | bus << BUS_SHIFT, ())

    def receive(self, frames: Sequence[Frame], now: int, ports: Sequence[Port]) -> None:
        """Hand the nodes what came from the buses and from each other; act on deadlines.

        Args:
            frames: what arrived since the last round, oldest first.
            now: the time [ns].
            ports: those of the nodes that may have something to do.
        """
        for deliver in self._deliveries:
            deliver(now)
        table = self._table
        time: Any = now  # made an object once for all handlers
        for frame in self._heard:
            for handle in self._inside.get(frame.can_id | frame.bus << BUS_SHIFT, ()):
                handle(frame, time)
        for frame in frames:
            can_id, _, _, is_extended, bus, fd = frame
            address = can_id | bus << BUS_SHIFT
            if is_extended or fd or address >= len(table) or not table[address]:
                self._receive_other(frame, now)
                continue
            for handle in table[address]:
                handle(frame, time)
        if now >= self._agenda.due:
            for port in ports:
                port.node.expire(now)

    def _receive_other(self, frame: Frame, now: int) -> None:
        """Take a frame that no CANopen node listens to, as none does to CAN FD."""
        is_theirs = frame.is_extended and not frame.fd
        handle = self._extended.get(frame.bus) if is_theirs else None
        if handle is None:
            self.unrouted += 1
        else:
            handle(frame, now)

    def count_foreign(self, frame: Frame, now: int) -> None:
        """Count a frame from elsewhere that has an identifier of one of our nodes."""
        if not frame.is_extended and not frame.fd:
            for watch in self._watches.get(address_of(frame.can_id, frame.bus), ()):
                watch(frame, now)

    def send(self, now: int, ports: Sequence[Port]) -> list[Frame]:
        """Return the frames of this round: PDOs that are due, then services that have time.

        Args:
            now: the time [ns].
            ports: those of the nodes that may have something to do.
        """
        for release in self._releases:
            release()
        for port in ports:
            port.node.transmit_pdos(now, port.emit)
        if now >= self._agenda.due:
            for port in ports:
                port.node.serve(now, port.emit)
            self._look_ahead(ports)
        if not self._sent:
            if self._heard:
                self._heard = []
            return []
        sent = self._sent.copy()
        self._sent.clear()
        self._heard = self._overheard_of(sent)
        return sent

    def _overheard_of(self, sent: Sequence[Frame]) -> list[Frame]:
        """Return those frames of our nodes that another one listens to."""
        marks = self._marks
        found = []
        for frame in sent:
            can_id, _, _, _, bus, _ = frame
            address = can_id | bus << BUS_SHIFT
            if address < len(marks) and marks[address]:
                found.append(frame)
        return found

    def _settle(self, frame: Frame, now: int) -> None:
        """Before a SYNC acts that is not the round's first: send the PDOs of the one before."""
        if now == self._synchronised_at and not frame.is_remote:
            for port in self._listeners[frame.can_id | frame.bus << BUS_SHIFT]:
                if port.release is not None:
                    port.release()
                port.node.settle_pdos(now, port.emit)
        self._synchronised_at = now

    def _look_ahead(self, ports: Sequence[Port]) -> None:
        """Follow these nodes' identifiers, and find the next deadline once all have been served.

        As long as some have not, the last one stands: it may be too early, never too late.
        """
        self._follow_routes(ports)
        if ports is self.ports:
            self._agenda.due = min(node.deadline for node in self.nodes)

    def _follow_routes(self, ports: Sequence[Port]) -> None:
        if any(port.node.routes is not self._merged[port.node] for port in ports):
            self._merge_routes()

    def _plug_in(self) -> None:
        """Give each node its way to the bus, and find the nodes' listeners anew."""
        self.ports = tuple(self._port(node, bus) for node, bus in self._buses.items())
        late = [way for layer in self._layers.values() for way in layer.values() if way.may_delay]
        self._laid = bool(late)
        self._deliveries = [way.deliver for way in late] + self._preludes
        self._releases = [port.release for port in self.ports if port.release is not None]
        self._merge_routes()
        for plug in self._plugs:
            plug()

    def _port(self, node: Node, bus: int) -> Port:
        emit: Emit = _numbered(self._sent.append, bus) if bus else self._sent.append
        return Port(node, *self.connect(node, emit))

    def _merge_routes(self) -> None:
        """Join the nodes' routes into one table of COB-ID to all that listen to it."""
        self._merged: dict[Node, Routes] = {node: node.routes for node in self.nodes}
        routes: dict[int, list[Handler]] = {}
        listeners: dict[int, list[Port]] = {}
        self._watches: dict[int, list[Handler]] = {}
        requests, syncs = set[int](), set[int]()
        for port in self.ports:
            node, bus = port.node, self._buses[port.node]
            for can_id, handler in node.routes.items():
                address = address_of(can_id, bus)
                routes.setdefault(address, []).append(self.guard(node, handler))
                listeners.setdefault(address, []).append(port)
            for can_id in node.sent_ids:
                self._watches.setdefault(address_of(can_id, bus), []).append(_foreign_counter(node))
            requests |= {address_of(can_id, bus) for can_id in node.sdo_ids}
            if node.sync_id is not None:
                syncs.add(address_of(node.sync_id, bus))
        self._inside: dict[int, tuple[Handler, ...]] = {
            address: (self._settle, *handlers) if address in syncs else tuple(handlers)
            for address, handlers in routes.items()
        }
        # Where frames take time, what comes may be our own.
        watches = {} if self.knows_senders else self._watches
        self.routes = {
            address: (*watches.get(address, ()), *self._inside.get(address, ()))
            for address in routes | watches
        }
        self._listeners = {address: tuple(ports) for address, ports in listeners.items()}
        # A node routes what it sends itself too, so a second handler is another node's.
        self._overheard = frozenset(
            address for address, handlers in routes.items() if len(handlers) > 1
        )
        end = max([0, *self.routes]) + 1
        table: list[tuple[Handler, ...]] = [()] * end
        for address, route in self.routes.items():
            table[address] = route
        marks = bytearray(end)
        for address in self._overheard:
            marks[address] = True
        self._table, self._marks = table, bytes(marks)
        self._timeless = frozenset(requests - self._overheard)


def _release(way: Way, emit: Emit, before: Callable[[], None] | None) -> None:
    """Send the late frames of a way, after those of the one nearer to the bus."""
    if before is not None:
        before()
    way.release(emit)


def _foreign_counter(node: Node) -> Handler:
    """Return a handler that counts foreign frames with an identifier that a node sends with."""
    counters = node.counters

    def count(frame: Frame, _now: int) -> None:
        counters.foreign_frames += not frame.is_remote

    return count


def _numbered(emit: Emit, bus: int) -> Emit:
    """Return a callable that sets the bus number of a frame before `emit` takes it."""

    def number(frame: Frame) -> None:
        can_id, data, is_remote, is_extended, _, fd = frame
        emit(make_frame(Frame, (can_id, data, is_remote, is_extended, bus, fd)))

    return number
