"""One tick of the bench: frames and a time in, frames out.

The order inside a tick is fixed, as in the real-time thread of a CANopen device:

1. received frames, in the order they came: NMT, SYNC and RPDO act at once, SDO requests wait; where
   several SYNCs share a tick, each is answered by PDOs of its own: those of the last by 4., those
   of the others when the next SYNC comes, with the values that the tick has found;
2. deadlines that have passed: RPDO time-outs, lost heartbeats, SDO time-outs;
3. for each axis: the valve's command, the plant's sub-steps, the sensors' new values;
4. TPDOs that are due;
5. what has time: boot-up, SDO answers, EMCY, heartbeats.

A frame that one node of the bench sends is heard by the other nodes of the bench in the next tick,
as on a wire.
"""

from collections.abc import Mapping, Sequence
from itertools import chain

from hil_bench.axis import Axis, PositionMeasurement, PressureMeasurement
from hil_bench.canopen_device.agenda import Agenda
from hil_bench.canopen_device.frame import BUS_SHIFT, Emit, Frame, Handler, address_of
from hil_bench.canopen_device.node import Node
from hil_bench.faults.faults import Faults


class Bench:
    """All axes and nodes, on one bus or more: a frame says by its number on which.

    Args:
        axes: the cylinders, at least one.
        nodes: every CANopen node on the bus.
        steps: plant steps in one tick, one or more.
        faults: what may go wrong; without it nothing can.
        buses: the number of the bus of each node; without it all are on bus 0.

    Attributes:
        pressures: the pressure transducers of all axes.
        positions: the position sensors of all axes.
    """

    def __init__(
        self,
        axes: Sequence[Axis],
        nodes: Sequence[Node],
        *,
        steps: int,
        faults: Faults | None = None,
        buses: Mapping[Node, int] | None = None,
    ) -> None:
        self.axes = tuple(axes)
        self.nodes = tuple(nodes)
        self.faults = faults or Faults()
        self._buses = {node: bus for node, bus in (buses or {}).items() if bus}
        self.commands = [0.0] * len(self.axes)
        sensors = [sensor for axis in self.axes for sensor in axis.sensors]
        self.pressures = tuple(s for s in sensors if isinstance(s, PressureMeasurement))
        self.positions = tuple(s for s in sensors if isinstance(s, PositionMeasurement))
        self.unrouted = 0
        self._steps = steps
        self._agenda = Agenda()
        for node in self.nodes:
            node.agenda.whole = self._agenda
            self._agenda.bring_forward(node.deadline)
        self._routes: dict[int, tuple[Handler, ...]] = {}
        self._listeners: dict[int, tuple[Node, ...]] = {}
        self._merged: dict[Node, Mapping[int, Handler]] = {}
        self._lines = self.faults.lines
        self._overheard: frozenset[int] = frozenset()
        self._timeless: frozenset[int] = frozenset()
        self._heard: list[Frame] = []
        self._settled: list[Frame] = []
        self._synchronised_at: int | None = None
        self._merge_routes()

    def start(self, now: int) -> None:
        """Power all nodes on at `now` [ns]; each boots up in the first tick."""
        for node in self.nodes:
            node.start(now)
        self.faults.start(now)
        self._follow_routes(self.nodes)

    @property
    def routes(self) -> Mapping[int, tuple[Handler, ...]]:
        """Every COB-ID that some node listens to, by `address_of`; a new object after a change."""
        return self._routes

    def is_timeless(self, frame: Frame) -> bool:
        """Return whether a frame may be served between two ticks: an SDO request, or for nobody.

        None may while a frame that one of our nodes has sent waits for the next tick to be heard by
        another one, since nothing is to overtake it.
        """
        if self._heard:
            return False
        address = frame.can_id | frame.bus << BUS_SHIFT
        return frame.is_extended or address in self._timeless or address not in self._routes

    def tick(self, frames: Sequence[Frame], now: int) -> list[Frame]:
        """Move the whole bench on by one tick.

        Args:
            frames: what arrived since the last tick, oldest first.
            now: scheduled time of this tick [ns].

        Returns:
            The frames that the nodes send, in the order they would reach the bus.
        """
        if now >= self.faults.due:
            self.faults.advance(now)
            self._join_lines()
        self._take(frames, now, self.nodes)
        for hold in self.faults.holds:
            hold()
        for number, axis in enumerate(self.axes):
            self.commands[number] = axis.advance(now, self._steps)
        for babble in self.faults.babbles:
            babble(self._settled.append)
        return self._send(now, self.nodes)

    def serve(self, frames: Sequence[Frame], now: int) -> list[Frame]:
        """Do what a tick does, but leave plant and devices where they are: no time passes.

        Set-points that come so act in the next tick.

        Args:
            frames: what arrived, oldest first.
            now: the time, that of the last tick or later, before the next [ns].

        Returns:
            The frames that the nodes send, in the order they would reach the bus.
        """
        nodes = self._concerned(frames)
        self._take(frames, now, nodes)
        return self._send(now, nodes)

    def _concerned(self, frames: Sequence[Frame]) -> Sequence[Node]:
        """Return the nodes that may have something to do once these frames are received."""
        if len(frames) != 1 or self._heard or self._lines:
            return self.nodes
        (frame,) = frames
        address = frame.can_id | frame.bus << BUS_SHIFT
        return () if frame.is_extended else self._listeners.get(address, ())

    def _take(self, frames: Sequence[Frame], now: int, nodes: Sequence[Node]) -> None:
        """Receive what came from the bus and what our own nodes sent last; act on deadlines."""
        for line in self._lines.values():
            line.deliver(now)
        routes = self._routes
        for frame in chain(self._heard, frames):
            address = frame.can_id | frame.bus << BUS_SHIFT
            handlers = None if frame.is_extended else routes.get(address)
            if handlers is None:
                self.unrouted += 1
                continue
            for handle in handlers:
                handle(frame, now)
        if now >= self._agenda.due:
            for node in nodes:
                node.expire(now)

    def _settle(self, frame: Frame, now: int) -> None:
        """Before a SYNC acts that is not the tick's first: send the PDOs of the one before."""
        if now == self._synchronised_at and not frame.is_remote:
            for node in self._listeners[frame.can_id | frame.bus << BUS_SHIFT]:
                node.settle_pdos(now, self._way(node, now, self._settled.append))
        self._synchronised_at = now

    def _send(self, now: int, nodes: Sequence[Node]) -> list[Frame]:
        """Return what is settled and what these nodes send: PDOs, then what has time."""
        sent, self._settled = self._settled, []
        if self._lines or self._buses:
            self._send_each_its_way(now, sent, nodes)
        else:
            emit = sent.append
            for node in nodes:
                node.transmit_pdos(now, emit)
            if now >= self._agenda.due:
                for node in nodes:
                    node.serve(now, emit)
        if now >= self._agenda.due:
            self._look_ahead(nodes)
        self._heard = self._overheard_of(sent) if sent else []
        return sent

    def _overheard_of(self, sent: Sequence[Frame]) -> list[Frame]:
        """Return those frames of our nodes that another one listens to."""
        overheard = self._overheard
        return [frame for frame in sent if frame.can_id | frame.bus << BUS_SHIFT in overheard]

    def _send_each_its_way(self, now: int, sent: list[Frame], nodes: Sequence[Node]) -> None:
        """Send as `_send` does, each node on its bus, and by its line where that has a fault."""
        emits = [self._way(node, now, sent.append) for node in nodes]
        for node, emit in zip(nodes, emits, strict=True):
            node.transmit_pdos(now, emit)
        for node, emit in zip(nodes, emits, strict=True):
            node.serve(now, emit)

    def _look_ahead(self, nodes: Sequence[Node]) -> None:
        """Follow these nodes' identifiers, and find the next deadline once all have been served.

        As long as some have not, the last one stands: it may be too early, never too late.
        """
        self._follow_routes(nodes)
        if nodes is self.nodes:
            self._agenda.due = min(node.deadline for node in nodes)

    def _follow_routes(self, nodes: Sequence[Node]) -> None:
        if any(node.routes is not self._merged[node] for node in nodes):
            self._merge_routes()

    def _way(self, node: Node, now: int, emit: Emit) -> Emit:
        """Return where a node sends to."""
        bus, line = self._buses.get(node), self._lines.get(node)
        put = (lambda frame: emit(frame._replace(bus=bus))) if bus else emit
        return line.sender(now, put) if line else put

    def _join_lines(self) -> None:
        """Let the frames of nodes with a fault on their line go that way."""
        if self.faults.lines is not self._lines:
            self._lines = self.faults.lines
            self._merge_routes()

    def _merge_routes(self) -> None:
        """Join the nodes' routes into one table of COB-ID to all that listen to it."""
        self._merged = {node: node.routes for node in self.nodes}
        routes: dict[int, list[Handler]] = {}
        listeners: dict[int, list[Node]] = {}
        for node, table in self._merged.items():
            line = self._lines.get(node)
            bus = self._buses.get(node, 0)
            for can_id, handler in table.items():
                address = address_of(can_id, bus)
                taker = handler if line is None else line.guard(handler)
                routes.setdefault(address, []).append(taker)
                listeners.setdefault(address, []).append(node)
        first = dict.fromkeys(self._syncs(), (self._settle,))
        self._routes = {
            address: (*first.get(address, ()), *handlers) for address, handlers in routes.items()
        }
        self._listeners = {address: tuple(nodes) for address, nodes in listeners.items()}
        # A node routes what it sends itself too, so a second handler is another node's.
        self._overheard = frozenset(
            address for address, handlers in routes.items() if len(handlers) > 1
        )
        requests = {
            address_of(can_id, self._buses.get(node, 0))
            for node in self.nodes
            for can_id in node.sdo_ids
        }
        self._timeless = frozenset(requests - self._overheard)

    def _syncs(self) -> set[int]:
        """Return the addresses of SYNC, of all nodes."""
        return {
            address_of(node.sync_id, self._buses.get(node, 0))
            for node in self.nodes
            if node.sync_id is not None
        }
