"""A bench that runs: what moves it, what watches it, and where commands come in.

A runner calls `tick` and `serve` and knows nothing else of the bench; an observer is told what
passed and knows nothing of the runner. All times are bench time: nanoseconds since power-on.
"""

from collections.abc import Callable, Mapping, Sequence

from hil_bench.bench.assembly import build_bench
from hil_bench.bench.bench import Bench, FrameObserver
from hil_bench.bench.commands import Controls, Device, Door
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.node_objects import NodeObjects, NodeTable
from hil_bench.bench.peers import Peers
from hil_bench.canopen_device.frame import Frame
from hil_bench.outside.recording.channels import Channel

# The recorded channels of a bench: one row of SI values a tick.
#
# First what each axis does, then what each of its sensors measures, with the sensor's errors,
# delay and noise. The spool is in fractions of the valve's full opening, as on the bus.


def bench_channels(bench: Bench) -> tuple[Channel, ...]:
    """Return the channels of a row of `sample`: `AXIS.QUANTITY`, then `SENSOR.measured`."""
    channels = [
        Channel(f"{axis.name}.{quantity.name}", quantity.unit)
        for axis in bench.axes
        for quantity in axis.recorded
    ]
    channels += [Channel(*channel) for sensor in bench.sensors for channel in sensor.channels]
    return tuple(channels)


def sample(bench: Bench) -> list[float]:
    """Return the present values of all `bench_channels`, in their order."""
    row: list[float] = []
    for number, axis in enumerate(bench.axes):
        row += axis.row(bench.commands[number])
    for sensor in bench.sensors:
        row.append(sensor.measured / sensor.full)
        if sensor.rate_path is not None:
            row.append(sensor.measured_rate)
    return row


RowObserver = Callable[[Sequence[float]], None]
"""Told the time [s] and a value a channel, in its SI unit, at the end of each tick."""

Send = Callable[[Sequence[Frame]], None]
"""Puts frames on the bus."""

TickObserver = Callable[[int], None]
"""Told the time [ns] at the end of each tick."""

Source = Callable[[int], Sequence[Frame]]
"""Given the time of a tick [ns] before it begins, returns what others on its buses in this process
have sent since the last one."""

Interceptor = Callable[[Sequence[Frame], int], Sequence[Frame]]
"""Given the frames that arrived for a tick and its time [ns], returns those that it takes."""


class Session:
    """A bench with its observers and its door.

    Args:
        bench: not yet powered on.
        nodes: the objects of its nodes, by the names of the nodes.
        devices: others of its devices that a command may read and set, by their names.
        stimuli: what else to record, each a function of bench time [s].

    Attributes:
        bench: as passed in.
        nodes: as passed in.
        channels: of a row, without the time.
        controls: what commands act on.
        door: takes commands from anywhere; they act at the start of the next tick.
        now: bench time [ns]: that of the last tick, or later where a runner has waited since.
        has_ticked: whether the first tick is over, in which the nodes boot.
        intercept: called at the start of each tick, before the commands of the door act; it may
            give the door some. None lets all frames pass.
        switches: of the power of others on its buses in this process, by name: "start", "kill" or
            "restart".
        preparations: called before the first tick of a paced run, whatever they take.
        farewells: called by another thread where a tick never ends, before the process does.
        sources: asked at the start of each tick, before `now` moves; what they send acts in it.
    """

    def __init__(
        self,
        bench: Bench,
        *,
        nodes: Mapping[str, NodeObjects] | None = None,
        devices: Mapping[str, Device] | None = None,
        stimuli: Mapping[Channel, Callable[[float], float]] | None = None,
    ) -> None:
        self.bench = bench
        self.nodes = nodes or {}
        stimuli = stimuli or {}
        self.channels = (*stimuli, *bench_channels(bench))
        self.controls = Controls(bench, {**self.nodes, **(devices or {})})
        self.door = Door(self.controls)
        self.now = 0
        self.has_ticked = False
        self.intercept: Interceptor | None = None
        self.preparations: list[Callable[[], None]] = []
        self.farewells: list[Callable[[], None]] = []
        self.sources: list[Source] = []
        self.switches: dict[str, Callable[[str], None]] = {}
        self._commands = self.door.waiting
        self._stimuli = tuple(stimuli.values())
        self._frame_observers: list[FrameObserver] = []
        self._told: list[FrameObserver] = []
        self._row_observers: list[RowObserver] = []
        self._tick_observers: list[TickObserver] = []

    def watch(
        self,
        *,
        frames: FrameObserver | None = None,
        rows: RowObserver | None = None,
        ticks: TickObserver | None = None,
    ) -> None:
        """Add an observer; at the end of a tick it is told the frames, the row, then the time.

        It is called in the thread of the bench, so it must be short.

        Args:
            frames: told all frames of a tick, and those that were served between two.
            rows: told the row of each tick; without any, no row is made.
            ticks: told each tick, after all frames and rows.
        """
        if frames is not None:
            self._told.append(frames)
            self._frame_observers.append(self._at_their_times(frames))
        if rows is not None:
            self._row_observers.append(rows)
        if ticks is not None:
            self._tick_observers.append(ticks)

    def unwatch(
        self,
        *,
        frames: FrameObserver | None = None,
        rows: RowObserver | None = None,
        ticks: TickObserver | None = None,
    ) -> None:
        """Take an observer away; between two ticks only.

        Args:
            frames: as given to `watch`.
            rows: likewise.
            ticks: likewise.
        """
        if frames is not None:
            place = self._told.index(frames)
            del self._told[place], self._frame_observers[place]
        if rows is not None:
            self._row_observers.remove(rows)
        if ticks is not None:
            self._tick_observers.remove(ticks)

    def _at_their_times(self, observe: FrameObserver) -> FrameObserver:
        """Return an observer that passes on each frame at its own time where it takes some."""
        for retell in self.bench.retells:
            observe = retell(observe)
        return observe

    def start(self) -> None:
        """Power the bench on; its nodes boot in the first tick."""
        self.bench.start(self.now)

    def tick(self, frames: Sequence[Frame], now: int, send: Send | None = None) -> Sequence[Frame]:
        """Move the bench on by one tick; return the frames that come from this process.

        Args:
            frames: what arrived since the last tick, oldest first.
            now: bench time of this tick [ns].
            send: is given those frames before the observers are told, so that the bus does not
                wait for them.
        """
        booted: Sequence[Frame] = ()
        if self.sources and not self.has_ticked and now > self.now:
            # What a source sends then meets nodes that are up.
            booted = self.tick((), self.now, send)
        guests = self._guests(now) if self.sources else ()
        if guests:
            frames = [*frames, *guests] if frames else guests
        self.now, self.has_ticked = now, True
        if self.intercept is not None:
            frames = self.intercept(frames, now)
        if self._commands:
            self.door.admit(now)
        sent = self.bench.tick(frames, now)
        if send is not None:
            send([*guests, *sent] if guests else sent)
        for observe in self._frame_observers:
            observe(frames, sent, now)
        if self._row_observers:
            row = self.row()
            for show in self._row_observers:
                show(row)
        for tell in self._tick_observers:
            tell(now)
        return [*booted, *guests, *sent] if guests or booted else sent

    def _guests(self, now: int) -> Sequence[Frame]:
        """Ask the sources for their frames."""
        if len(self.sources) == 1:
            return self.sources[0](now)
        return [frame for source in self.sources for frame in source(now)]

    def row(self) -> tuple[float, ...]:
        """Return the time [s] and a value a channel, as they are now."""
        time = self.now * 1e-9
        stimuli = [stimulus(time) for stimulus in self._stimuli]
        return (time, *stimuli, *sample(self.bench))

    def serve(self, frames: Sequence[Frame], send: Send | None = None) -> Sequence[Frame]:
        """Let the bench answer frames while its time stands still; see `tick`."""
        now = self.now
        sent = self.bench.serve(frames, now)
        if send is not None:
            send(sent)
        for observe in self._frame_observers:
            observe(frames, sent, now)
        return sent


def open_session(
    config: BenchConfig, stimuli: Mapping[Channel, Callable[[float], float]] | None = None
) -> Session:
    """Return a session of the bench of a configuration, not yet powered on.

    Args:
        config: of the bench.
        stimuli: what else to record, each a function of bench time [s].
    """
    bench = build_bench(config)
    nodes = NodeTable(bench.nodes, config.nodes)
    return Session(bench, nodes=nodes, devices=bench.find(Peers), stimuli=stimuli)
