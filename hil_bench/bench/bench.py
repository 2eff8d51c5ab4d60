"""One tick of the bench: frames and a time in, frames out.

The order inside a tick is fixed, as in the real-time thread of a CANopen device:

1. received frames, in the order they came: NMT, SYNC and RPDO act at once, SDO requests wait; where
   several SYNCs share a tick, each is answered by PDOs of its own: those of the last by 4., those
   of the others when the next SYNC comes, with the values that the tick has found;
2. deadlines that have passed: RPDO time-outs, lost heartbeats, SDO time-outs;
3. the valves' commands of all axes; the plants' sub-steps, plants of a group all at once; the
   sensors' new values of all axes;
4. TPDOs that are due;
5. what has time: boot-up, SDO answers, EMCY, heartbeats.

A frame that one node of the bench sends is heard by the other nodes of the bench in the next tick,
as on a wire.

What a bench has beside plants and nodes is an `Extension`: it adds what it does to the places of
the tick, and the tick knows nothing else of it.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, TypeVar

from hil_bench.bench.switchboard import Switchboard
from hil_bench.canopen_device.frame import Frame, Handler
from hil_bench.devices.axis import Axis, Fitting, Measurement
from hil_bench.plants.plant import PlantGroup

Act = Callable[[int], None]
"""Does something in a tick, at its time [ns]."""

Sieve = Callable[[Sequence[Frame], int], Sequence[Frame]]
"""Given frames and a time [ns], returns those that go on."""

FrameObserver = Callable[[Sequence[Frame], Sequence[Frame], int], None]
"""Told the frames that the bench received and sent, and their time [ns].

Where frames take time on a bus it is told each by itself, at the time at which it had passed."""


class Extension(Protocol):
    """A part of a bench beside its plants and nodes."""

    def join(self, bench: "Bench") -> None:
        """Add what it does to the places of the tick, and its ways to the switchboard."""


class Event(Protocol):
    """Something that began or ended on a bench."""

    @property
    def time(self) -> int:
        """The bench time [ns]."""

    @property
    def what(self) -> str:
        """The sort of thing, in a word."""

    @property
    def name(self) -> str:
        """The thing itself; one that ends has the name with which it began."""

    @property
    def is_begin(self) -> bool:
        """True if it began."""

    @property
    def verb(self) -> str:
        """The event itself, as "begins"."""

    @property
    def note(self) -> str:
        """Further words on the thing, behind its name; empty for none."""

    @property
    def content(self) -> Mapping[str, object]:
        """The event for programs, without its time."""


class Medium(Protocol):
    """Buses on which frames take time.

    Attributes:
        is_direct: whether a user in the same thread puts frames at any time, not with a tick.
    """

    is_direct: bool

    def takes(self, frame: Frame) -> bool:
        """Return True if `put` takes a frame at any time."""

    def put(self, frame: Frame, now: int) -> bool:
        """Have the user want to send a frame from now on [ns]; return whether it had room."""

    def next_frame(self, until: int) -> tuple[Frame, int] | None:
        """Return the next frame that passes, and when [ns]; None where none does until then."""

    def reported(self) -> Sequence[Frame]:
        """Return the error frames of the last tick."""

    def point(self, device: object) -> Any:  # noqa: ANN401 - of the medium
        """Return the end where a device is plugged in; None where its bus takes no time."""

    def standing(self, device: object) -> Mapping[str, object] | None:
        """Return the status of a device's CAN controller; None where its bus takes no time."""

    def lines(self, names: Sequence[str]) -> list[str]:
        """Return the lines on the buses in the summary of a run, whose names are by number."""


ExtensionT = TypeVar("ExtensionT")


class Bench:
    """All axes and nodes, on one bus or more: a frame says by its number on which.

    Args:
        axes: the cylinders, at least one.
        switchboard: every CANopen node, and its bus.
        steps: plant steps in one tick, one or more.
        fittings: what the device of each node does, in the order of the nodes.
        sensors: what is recorded of them, in that order.

    Attributes:
        nodes: every CANopen node.
        switchboard: as passed in.
        commands: what each axis was commanded in the last tick [SI].
        is_timeless: whether a frame may be served between two ticks; see `Switchboard`.
        medium: the buses on which frames take time; None where all take none.
        groups: plants that move at once, each group with the numbers of its axes.
        single: the numbers of all other axes.
        starts: called when the power comes on, after the nodes have got it.
        arrivals: given the frames that arrived for a tick, before anything else.
        begins: called before frames are received.
        holds: called before the plants move.
        acts: called after the plants and their sensors.
        finishes: called before the nodes send.
        served: given the frames that are to be served between two ticks.
        departures: given what was sent, in a tick and between two.
        extensions: those of the bench, in the order in which they joined.
        events: what began and ended on it last, oldest first, by the names of such things.
        retells: make an observer of frames into one that gets them as they passed.
    """

    def __init__(
        self,
        axes: Sequence[Axis],
        switchboard: Switchboard,
        *,
        steps: int,
        fittings: Sequence[Fitting] = (),
        sensors: Sequence[Measurement] = (),
    ) -> None:
        self.medium: Medium | None = None
        self.axes = tuple(axes)
        self.group(())
        self._inputs = [0.0] * len(self.axes)
        self._outputs: list[Sequence[float]] = [()] * len(self.axes)
        self.nodes = switchboard.nodes
        self.is_timeless: Callable[[Frame], bool] = switchboard.is_timeless
        self.commands = [0.0] * len(self.axes)
        self.fittings = tuple(fittings)
        self.sensors = tuple(sensors)
        self.switchboard = switchboard
        self._steps = steps
        self.extensions: list[Extension] = []
        self.events: dict[str, Sequence[Event]] = {}
        self.starts: list[Act] = []
        self.arrivals: list[Sieve] = []
        self.begins: list[Act] = []
        self.holds: list[Act] = []
        self.acts: list[Act] = [act for each in self.fittings if (act := each.advance) is not None]
        self.finishes: list[Act] = []
        self.served: list[Sieve] = []
        self.departures: list[Sieve] = []
        self.retells: list[Callable[[FrameObserver], FrameObserver]] = []

    def extend(self, extension: Extension) -> None:
        """Let an extension act in the ticks from now on, after those that are there."""
        self.extensions.append(extension)
        extension.join(self)

    def find(self, kind: type[ExtensionT]) -> ExtensionT | None:
        """Return the extension of a class; None where the bench has none."""
        for each in self.extensions:
            if isinstance(each, kind):
                return each
        return None

    def part(self, kind: type[ExtensionT]) -> ExtensionT:
        """Return the extension of a class.

        Raises:
            LookupError: the bench has none.
        """
        found = self.find(kind)
        if found is None:
            raise LookupError(f"this bench has no {kind.__name__}")
        return found

    def group(self, groups: Sequence[tuple[Sequence[int], PlantGroup]]) -> None:
        """Move plants at once from now on: those of each group, with the numbers of its axes."""
        self.groups = tuple(groups)
        grouped = {number for numbers, _ in self.groups for number in numbers}
        self.single = [number for number in range(len(self.axes)) if number not in grouped]

    def start(self, now: int) -> None:
        """Power all nodes on at `now` [ns]; each boots up in the first tick."""
        self.switchboard.start(now)
        for start in self.starts:
            start(now)

    @property
    def routes(self) -> Mapping[int, tuple[Handler, ...]]:
        """Every COB-ID that some node listens to, by `address_of`; a new object after a change."""
        return self.switchboard.routes

    @property
    def unrouted(self) -> int:
        """The number of received frames that no node listens to."""
        return self.switchboard.unrouted

    def tick(self, frames: Sequence[Frame], now: int) -> Sequence[Frame]:
        """Move the whole bench on by one tick.

        Args:
            frames: what arrived since the last tick, oldest first.
            now: scheduled time of this tick [ns].

        Returns:
            The frames that the nodes send, in the order they would reach the bus.
        """
        switchboard = self.switchboard
        for sift in self.arrivals:
            frames = sift(frames, now)
        for begin in self.begins:
            begin(now)
        switchboard.receive(frames, now, switchboard.ports)
        for hold in self.holds:
            hold(now)
        self._advance_axes(now)
        for act in self.acts:
            act(now)
        for finish in self.finishes:
            finish(now)
        sent: Sequence[Frame] = switchboard.send(now, switchboard.ports)
        for sift in self.departures:
            sent = sift(sent, now)
        return sent

    def _advance_axes(self, now: int) -> None:
        axes, commands, inputs, outputs = self.axes, self.commands, self._inputs, self._outputs
        for number, axis in enumerate(axes):
            commands[number], inputs[number] = axis.command(now)
        for number in self.single:
            outputs[number] = axes[number].plant.drive(inputs[number], self._steps)
        for numbers, group in self.groups:
            given = [inputs[number] for number in numbers]
            for number, output in zip(numbers, group.drive(given, self._steps), strict=True):
                outputs[number] = output
        for number, axis in enumerate(axes):
            axis.publish(outputs[number], now)

    def serve(self, frames: Sequence[Frame], now: int) -> Sequence[Frame]:
        """Do what a tick does, but leave plant and devices where they are: no time passes.

        Set-points that come so act in the next tick.

        Args:
            frames: what arrived, oldest first.
            now: the time, that of the last tick or later, before the next [ns].

        Returns:
            The frames that the nodes send, in the order they would reach the bus.
        """
        for sift in self.served:
            frames = sift(frames, now)
            if not frames:
                return ()
        ports = self.switchboard.concerned(frames)
        self.switchboard.receive(frames, now, ports)
        sent: Sequence[Frame] = self.switchboard.send(now, ports)
        for sift in self.departures:
            sent = sift(sent, now)
        return sent
