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
"""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from hil_bench.bench.segment import Segment
from hil_bench.bench.switchboard import Switchboard
from hil_bench.canopen_device.frame import Frame, Handler
from hil_bench.devices.axis import Axis, Fitting, Measurement
from hil_bench.devices.faults.faults import Faults
from hil_bench.plants.plant import PlantGroup

if TYPE_CHECKING:
    from hil_bench.bench.wiring import Wiring


class Bench:
    """All axes and nodes, on one bus or more: a frame says by its number on which.

    Args:
        axes: the cylinders, at least one.
        switchboard: every CANopen node, and its bus.
        steps: plant steps in one tick, one or more.
        faults: what may go wrong; without it nothing can.
        fittings: what the device of each node does, in the order of the nodes.
        sensors: what is recorded of them, in that order.

    Attributes:
        nodes: every CANopen node.
        commands: what each axis was commanded in the last tick [SI].
        is_timeless: whether a frame may be served between two ticks; see `Switchboard`.
        wiring: its buses of copper; None where all buses take no time.
        segments: the J1939 devices of each bus that has some.
        groups: plants that move at once, each group with the numbers of its axes.
        single: the numbers of all other axes.
    """

    def __init__(
        self,
        axes: Sequence[Axis],
        switchboard: Switchboard,
        *,
        steps: int,
        faults: Faults | None = None,
        fittings: Sequence[Fitting] = (),
        sensors: Sequence[Measurement] = (),
    ) -> None:
        self.wiring: Wiring | None = None
        self.axes = tuple(axes)
        self.group(())
        self._inputs = [0.0] * len(self.axes)
        self._outputs: list[Sequence[float]] = [()] * len(self.axes)
        self.nodes = switchboard.nodes
        self.faults = faults or Faults()
        self.is_timeless: Callable[[Frame], bool] = switchboard.is_timeless
        self.commands = [0.0] * len(self.axes)
        self.fittings = tuple(fittings)
        self.sensors = tuple(sensors)
        self._acts = [each.advance for each in self.fittings if each.advance is not None]
        self.segments: tuple[Segment, ...] = ()
        self._switchboard = switchboard
        self._steps = steps
        switchboard.lay(self.faults.lines)

    def join(self, segments: Sequence[Segment]) -> None:
        """Plug J1939 devices in."""
        self.segments = tuple(segments)
        for segment in self.segments:
            segment.join(self._switchboard, self.wiring)
            self._acts.append(segment.advance)

    def group(self, groups: Sequence[tuple[Sequence[int], PlantGroup]]) -> None:
        """Move plants at once from now on: those of each group, with the numbers of its axes."""
        self.groups = tuple(groups)
        grouped = {number for numbers, _ in self.groups for number in numbers}
        self.single = [number for number in range(len(self.axes)) if number not in grouped]

    def start(self, now: int) -> None:
        """Power all nodes on at `now` [ns]; each boots up in the first tick."""
        self._switchboard.start(now)
        for segment in self.segments:
            segment.start(now)

    @property
    def routes(self) -> Mapping[int, tuple[Handler, ...]]:
        """Every COB-ID that some node listens to, by `address_of`; a new object after a change."""
        return self._switchboard.routes

    @property
    def unrouted(self) -> int:
        """The number of received frames that no node listens to."""
        return self._switchboard.unrouted

    def tick(self, frames: Sequence[Frame], now: int) -> list[Frame]:
        """Move the whole bench on by one tick.

        Args:
            frames: what arrived since the last tick, oldest first.
            now: scheduled time of this tick [ns].

        Returns:
            The frames that the nodes send, in the order they would reach the bus.
        """
        switchboard = self._switchboard
        if now >= self.faults.due:
            self.faults.advance(now)
            switchboard.lay(self.faults.lines)
        switchboard.receive(frames, now, switchboard.ports)
        for hold in self.faults.holds:
            hold()
        self._advance_axes(now)
        for act in self._acts:
            act(now)
        for babble in self.faults.babbles:
            babble(switchboard.emit)
        return switchboard.send(now, switchboard.ports)

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

    def serve(self, frames: Sequence[Frame], now: int) -> list[Frame]:
        """Do what a tick does, but leave plant and devices where they are: no time passes.

        Set-points that come so act in the next tick.

        Args:
            frames: what arrived, oldest first.
            now: the time, that of the last tick or later, before the next [ns].

        Returns:
            The frames that the nodes send, in the order they would reach the bus.
        """
        ports = self._switchboard.concerned(frames)
        self._switchboard.receive(frames, now, ports)
        return self._switchboard.send(now, ports)
