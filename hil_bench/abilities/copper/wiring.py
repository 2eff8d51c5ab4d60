"""The buses of a bench that are of copper: who puts frames there, and who hears them when."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar, Final

from hil_bench.abilities.copper.wire.error_frames import broken_frame, event_frame
from hil_bench.abilities.copper.wire.station import Rule, Station
from hil_bench.abilities.copper.wire.wire import ErrorFrame, Passage, Wire
from hil_bench.canopen_device.emcy import CanEvent
from hil_bench.canopen_device.frame import Emit, Frame, Handler
from hil_bench.canopen_device.node import Node

_MOST_ERRORS: Final = 10_000

Device = Any
"""A CANopen node, or another device of the bench."""


@dataclass(slots=True)
class Bus:
    """One bus of copper.

    Attributes:
        number: of the bus.
        wire: the bus itself.
        controller: sends what comes from outside.
        babbler: sends what a babbling node sends.
        wires: all wires of the bench.
    """

    number: int
    wire: Wire
    controller: Station
    babbler: Station
    wires: list[Wire] = field(default_factory=list)


@dataclass(slots=True)
class Plug:
    """A node or a J1939 device at its bus; where faults get at it.

    Attributes:
        node: that device.
        bus: where it belongs.
        station: its CAN controller.
        wire: what it is connected to: that of its bus, or while its plug is pulled one of its own.
        events: what the CAN controller has to tell the node.
    """

    node: Device
    bus: Bus
    station: Station
    wire: Wire
    events: list[CanEvent] = field(default_factory=list)
    _pulled: int = 0

    def disturb(self, rule: Rule, *, is_sent: bool) -> None:
        """Have a rule disturb what the node sends, or what it reads."""
        self._rules(is_sent=is_sent).append(rule)
        self.wire.watch_rules()

    def spare(self, rule: Rule, *, is_sent: bool) -> None:
        """Take the rule back."""
        self._rules(is_sent=is_sent).remove(rule)
        self.wire.watch_rules()

    def force_off(self, now: int) -> None:
        """Make the node bus-off at `now` [ns]."""
        self.wire.force_off(self.station, now)

    def let_recover(self, now: int) -> None:
        """Let it recover from `now` [ns] on."""
        self.wire.let_recover(self.station, now)

    def stick(self, now: int) -> None:
        """Let its transceiver hold the bus dominant from `now` [ns] on."""
        self.bus.wire.stick(now)

    def unstick(self, now: int) -> None:
        """Let it leave the bus at `now` [ns]."""
        self.bus.wire.unstick(now)

    def pull(self, now: int) -> None:
        """Pull its plug at `now` [ns]: it is alone on a wire of its own."""
        self._pulled += 1
        if self._pulled == 1:
            end = self.bus.wire.make_end()
            self.bus.wires.append(end)
            self._move(end, now)

    def plug(self, now: int) -> None:
        """Plug it in again at `now` [ns]."""
        self._pulled -= 1
        if not self._pulled:
            self.bus.wires.remove(self.wire)
            self._move(self.bus.wire, now)

    def _move(self, wire: Wire, now: int) -> None:
        self.wire.leave(self.station, now)
        self.wire = wire
        wire.join(self.station, now)

    def _rules(self, *, is_sent: bool) -> list[Rule]:
        return self.station.send_rules if is_sent else self.station.receive_rules

    def standing(self) -> dict[str, object]:
        """Return the status of the node's CAN controller: its state, counters and losses."""
        station = self.station
        return {
            "state": station.state.value,
            "tec": station.tec,
            "rec": station.rec,
            "waiting": station.waiting,
            "failed": station.errors,
            "lost": station.refused,
            "missed": station.missed,
        }


class Wiring:
    """All buses of copper of a bench.

    Args:
        buses: those buses; a bus that is not among them takes no time.
        plugs: the nodes that are on them.

    Attributes:
        buses: by their numbers.
        plugs: by the nodes.
        now: the time at which nodes put frames [ns].
        passed: what has passed since the last tick, in the order of the ends.
        errors: error frames since then, as the adapter of the controller reports them, with their
            times [ns].
        is_direct: whether a user in the same thread puts frames at any time, not with a tick.
    """

    def __init__(self, buses: Sequence[Bus], plugs: Sequence[Plug]) -> None:
        self.buses = {bus.number: bus for bus in buses}
        self.plugs = {plug.node: plug for plug in plugs}
        self.now = 0
        self.passed: list[Passage] = []
        self.errors: list[tuple[Frame, int]] = []
        self.is_direct = True
        self._wires = [bus.wire for bus in buses]
        self._outside = frozenset(bus.controller for bus in buses)
        self._extended = frozenset(
            plug.station for plug in plugs if not isinstance(plug.node, Node)
        )
        self._deaf: dict[int, frozenset[Station]] = {}
        self._shaken: list[Plug] = []
        stations = {plug.station: plug for plug in plugs}

        def tell(station: Station, event: CanEvent) -> None:
            plug = stations.get(station)
            if plug is None:
                self._keep_event(station, event)
            else:
                plug.events.append(event)
                self._shaken.append(plug)

        for bus in buses:
            bus.wire.on_event = tell
            bus.wires = self._wires
            bus.wire.on_error = partial(self._keep_error, bus)

    def _keep_event(self, station: Station, event: CanEvent) -> None:
        for bus in self.buses.values():
            if station is bus.controller:
                frame = event_frame(event, station, bus.number)
                if frame is not None and len(self.errors) < _MOST_ERRORS:
                    self.errors.append((frame, bus.wire.free_at))

    def _keep_error(self, bus: Bus, error: ErrorFrame) -> None:
        if len(self.errors) < _MOST_ERRORS:
            self.errors.append((broken_frame(error, bus.controller, bus.number), error.end))

    def takes(self, frame: Frame) -> bool:
        """Return True if `put` takes a frame at any time."""
        return self.is_direct and frame.bus in self.buses

    def put(self, frame: Frame, now: int) -> bool:
        """Have the controller send a frame on a bus of copper; return whether it had room."""
        bus = self.buses[frame.bus]
        return bus.wire.put(bus.controller, frame, now)

    def put_all(self, frames: Sequence[Frame], now: int) -> list[Frame]:
        """Have the controller send frames; return those of buses that take no time."""
        direct = []
        for frame in frames:
            if frame.bus in self.buses:
                self.put(frame, now)
            else:
                direct.append(frame)
        return direct

    def advance(self, until: int) -> Passage | None:
        """Let time pass on all buses until the next frame has passed, at the latest `until` [ns].

        It is kept in `passed`, too.
        """
        while True:
            next_wire: Wire | None = None
            for wire in self._wires:
                if wire.can_step(until) and (next_wire is None or wire.due < next_wire.due):
                    next_wire = wire
            if next_wire is None:
                break
            passage = next_wire.step()
            if passage is not None:
                self.passed.append(passage)
                return passage
        for wire in self._wires:
            wire.look(until)
        return None

    def next_frame(self, until: int) -> tuple[Frame, int] | None:
        """Return the next frame of a node of the bench, and its end [ns]; see `advance`."""
        while (passage := self.advance(until)) is not None:
            if not self.is_outside(passage):
                return passage.frame, passage.end
        return None

    def is_outside(self, passage: Passage) -> bool:
        """Return True if a frame came from outside the bench."""
        return passage.station in self._outside

    def is_extended(self, passage: Passage) -> bool:
        """Return True if a frame came from a J1939 device of the bench, whose others hear it."""
        return passage.station in self._extended

    def take_errors(self) -> list[tuple[Frame, int]]:
        """Return the error frames, once."""
        errors, self.errors = self.errors, []
        return errors

    def take_passed(self) -> list[Passage]:
        """Return the frames that have passed since the last call."""
        passed, self.passed = self.passed, []
        return passed

    def frame_of(self, passage: Passage) -> Frame:
        """Return a passed frame for the nodes; those that could not read it will not get it.

        Nor will a J1939 device get what it has sent itself.
        """
        deaf = passage.deaf
        if passage.station in self._extended:
            deaf = frozenset((*deaf, passage.station))
        if not deaf:
            return passage.frame
        frame = Frame(*passage.frame)  # one of its own, to be known by
        self._deaf[id(frame)] = deaf
        return frame

    def forget(self) -> None:
        """Forget who could not read what: the nodes have heard all of it."""
        if self._deaf:
            self._deaf = {}

    def tell_nodes(self) -> None:
        """Tell the nodes what their CAN controllers have to say."""
        shaken, self._shaken = self._shaken, []
        for plug in shaken:
            for event in plug.events:
                if isinstance(plug.node, Node):
                    plug.node.take_can_event(event)
                elif event is CanEvent.RECOVERED:  # J1939 has no message for it
                    plug.node.rejoin(self.now)
            plug.events.clear()

    def ways(self) -> "dict[Device, PlugWay]":
        """Return the way of each device on copper."""
        return {device: PlugWay(self, plug) for device, plug in self.plugs.items()}

    def send_by(self, plug: Plug) -> Emit:
        """Return the callable that sends a device's frames."""
        number, station = plug.bus.number, plug.station

        def send(frame: Frame) -> None:
            if number:
                frame = frame._replace(bus=number)
            plug.wire.put(station, frame, self.now)

        return send

    def hear_by(self, plug: Plug, handle: Handler) -> Handler:
        """Wrap a device's handler so that it skips the frames that its station missed."""
        station = plug.station

        def take(frame: Frame, now: int) -> None:
            if self._deaf and station in self._deaf.get(id(frame), ()):
                return
            handle(frame, now)

        return take

    def stray(self, emit: Emit) -> Emit:
        """Return a callable for frames that no node sends; `emit` gets those of other buses."""

        def send(frame: Frame) -> None:
            bus = self.buses.get(frame.bus)
            if bus is None:
                emit(frame)
            else:
                bus.wire.put(bus.babbler, frame, self.now)

        return send


class PlugWay:
    """The way between a device and its bus of copper.

    Args:
        wiring: all buses of copper.
        plug: of the device.

    Attributes:
        may_delay: False: what is late is on the bus.
    """

    may_delay: ClassVar[bool] = False

    def __init__(self, wiring: Wiring, plug: Plug) -> None:
        self._wiring, self._plug = wiring, plug

    def sender(self, _emit: Emit) -> Emit:
        """Return the callable that puts the device's frames on the bus."""
        return self._wiring.send_by(self._plug)

    def guard(self, handle: Handler) -> Handler:
        """Wrap a handler so that it skips the frames that the device's station missed."""
        return self._wiring.hear_by(self._plug, handle)

    def deliver(self, now: int) -> None:
        """Do nothing: see `may_delay`."""

    def release(self, emit: Emit) -> None:
        """Do nothing: see `may_delay`."""
