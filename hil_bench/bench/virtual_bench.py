"""A bench on an embedded bus, with its traces: what tests, notebooks and the demo run.

>>> bench = VirtualBench(load_config("bench.toml"))
>>> bench.run(0.5)
>>> bench.signals["axis1.position"]
"""

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from functools import partial
from operator import methodcaller
from pathlib import Path
from typing import Any, Protocol, Self, cast

from hil_bench.ability import given_to, load, own_abilities
from hil_bench.bench.configuration import BenchConfig, load_config
from hil_bench.bench.peers import peers_of
from hil_bench.bench.session import Session, open_session
from hil_bench.canopen_device.frame import Frame
from hil_bench.errors import ConfigError, HilBenchError, WaitTimeoutError
from hil_bench.outside.realtime.pacer import Pacer
from hil_bench.outside.recording.channels import Channel, ChannelRecorder, LoggedFrame
from hil_bench.outside.recording.signal_table import SignalTable, as_table
from hil_bench.outside.transports.embedded import EmbeddedBus, EmbeddedPort

# Of an error that says what a test's controller did wrong, pytest shows the test's own line.
__tracebackhide__ = methodcaller("errisinstance", HilBenchError)

RECORDED_TIME = 60.0
"""Bench time that `VirtualBench.signals` reaches back unless told otherwise [s]."""

LOGGED_FRAMES = 100_000
"""Frames that `VirtualBench.frames` reaches back unless told otherwise."""


class Wish(Protocol):
    """Files to record in, as `hil_bench.RecordingWish`."""

    @property
    def paths(self) -> Sequence[Path | str]:
        """The files."""
        ...


class VirtualBench:
    """A powered-on bench in virtual time, in the caller's thread.

    Bench time advances only in `run`, in `run_until` and while somebody waits in `bus.recv`.

    Args:
        config: the bench; without it the built-in one of one axis.
        recorded_time: how far `signals` reaches back [s]; with 0 it and `values` stay empty.
        logged_frames: how many frames `frames` reaches back.
        pacer: holds the ticks back to real time; without it they follow at once.
        stimuli: what else to record, each a function of bench time [s], such as a set-point.
        session: of `config`, not yet powered on; without it, a new one.
        record: a file to record all signals and frames in, up to the end of the `with` block; or
            a `hil_bench.RecordingWish` for more than one, or from a trigger on.

    Attributes:
        config: as passed in.
        session: the bench that runs; its `door` takes commands from other threads.
        bench: axes and nodes.
        nodes: the objects of each node by the node's name, to read and to set:
            ``bench.nodes["io"]["0x6401.01"] = 1234``.
        ecus: the J1939 devices by their names: ``bench.ecus["joystick"]["x"] = -50``.
        bus: the controller's end of the bus, a python-can bus; of several, of the first.
        buses: the controller's ends of all buses, by their names in the configuration.
        frames: the latest frames both ways, oldest first.
        observers: told the bench time [s] at the end of each tick.
        pump: takes what arrives on the bus for some seconds of bench time. By default frames wait
            in the bus for whoever reads it; drivers put their network's `pump` here.
    """

    def __init__(
        self,
        config: BenchConfig | None = None,
        *,
        recorded_time: float = RECORDED_TIME,
        logged_frames: int = LOGGED_FRAMES,
        pacer: Pacer | None = None,
        stimuli: Mapping[Channel, Callable[[float], float]] | None = None,
        session: Session | None = None,
        record: Path | str | Wish | None = None,
    ) -> None:
        self.config = config or load_config()
        self.session = session or open_session(self.config, stimuli)
        self.bench = self.session.bench
        self.nodes = self.session.nodes
        self.ecus = peers_of(self.bench)
        self.frames: deque[LoggedFrame] = deque(maxlen=logged_frames)
        self.observers: list[Callable[[float], None]] = []
        rows = max(1, round(recorded_time * 1e9 / self.config.tick_ns))
        self._recorder = ChannelRecorder(self.session.channels, rows)
        log = self._log if logged_frames else None
        self.session.watch(frames=log, rows=self._recorder.append if recorded_time else None)
        self._open = ExitStack()
        self._recording = None
        if record is not None:
            opened = _recorded(self.session, record, self.config, is_real_time=pacer is not None)
            self._recording = self._open.enter_context(opened)
        self.session.watch(ticks=self._tell_observers)
        for part in self.config.parts:
            self._open.enter_context(part.attached(self.session, self.config))
        self.session.start()
        self.bus = EmbeddedBus(
            self.session.tick,
            self.config.tick_ns,
            pacer=pacer,
            medium=self.bench.medium,
            fd=self.config.bus.fd,
        )
        self.buses: dict[str, EmbeddedPort] = {
            name: self.bus.make_further(fd=bus.fd) if number else self.bus
            for number, (name, bus) in enumerate(self.config.buses.items())
        }
        self.pump: Callable[[float], None] = self.bus.advance
        self._clock: Callable[[], float] = self.bus.now

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Shut the buses down and end the recording; a second call does nothing."""
        self._shut_down()
        self.session.door.close()
        self._open.close()

    @property
    def recording(self) -> Any:  # noqa: ANN401 - of who records
        """The report on the files of `record`, a `RecordingReport`; None without such files."""
        return None if self._recording is None else self._recording.report

    @property
    def signals(self) -> SignalTable:
        """The signals so far, one row per tick: `time` [s] first, then the channels in SI units."""
        return as_table(self._recorder.result())

    @property
    def values(self) -> dict[str, float]:
        """The last row of `signals`, by the names of its channels; empty before the first tick."""
        return self._recorder.latest()

    def now(self) -> float:
        """Return the bench time [s]."""
        return self._clock()

    def run(self, duration: float) -> None:
        """Let bench time pass.

        Args:
            duration: how much [s].

        Raises:
            ValueError: that is negative or not finite.
        """
        if not 0.0 <= duration < math.inf:
            raise ValueError(f"duration {duration:g} s: give a finite time, 0 or more")
        self.pump(duration)

    def run_until(self, condition: Callable[[], bool], *, timeout: float) -> float:
        """Let bench time pass, tick by tick, until a condition holds.

        Args:
            condition: asked before the first tick and after each.
            timeout: longest wait [s].

        Returns:
            How long it took [s].

        Raises:
            WaitTimeoutError: it did not hold in time.
            ValueError: the time-out is negative or not a number.
        """
        if not timeout >= 0.0:
            raise ValueError(f"timeout {timeout:g} s: give a time, 0 or more")
        start = self.now()
        tick = self.config.tick_ns * 1e-9
        last_begin = start + timeout - 0.5 * tick
        while not condition():
            if self.now() > last_begin:
                raise WaitTimeoutError(f"condition not met within {timeout:g} s of bench time")
            self.pump(tick)
        return self.now() - start

    def leave_buses(self, pump: Callable[[float], None]) -> None:
        """Shut down `buses`, as another program is to control the bench on a bus of its own.

        From now on bench time is the session's, and passes in `run` and `run_until` as before.

        Args:
            pump: lets bench time pass [s].
        """
        self._shut_down()
        self.session.now = round(self.now() * 1e9)  # a wait may have ended between two ticks
        self._clock = lambda: self.session.now * 1e-9
        self.pump = pump

    def _shut_down(self) -> None:
        for bus in self.buses.values():
            bus.shutdown()

    def _log(self, received: Sequence[Frame], sent: Sequence[Frame], now: int) -> None:
        """Keep the frames of a tick, or of what was served between two."""
        for frame in received:
            self.frames.append(LoggedFrame(frame, now, is_received=True))
        for frame in sent:
            self.frames.append(LoggedFrame(frame, now, is_received=False))

    def _tell_observers(self, now: int) -> None:
        time = now * 1e-9
        for observe in self.observers:
            observe(time)

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - of any ability
        """Return a method or an attribute that an ability brings, as `modbus_link` and `faults`.

        Raises:
            AttributeError: none brings this one.
        """
        for ability in own_abilities() if not name.startswith("_") else ():
            if place := ability.bench_attributes.get(name):
                return cast("Callable[[VirtualBench], Any]", load(place))(self)
            if place := ability.bench_methods.get(name):
                return partial(cast("Callable[..., Any]", load(place)), self)
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")


# The reader of a bench's frames that an ability brings, for reports.


class FrameReader(Protocol):
    """Puts frames in words."""

    def name(self, frame: Frame) -> str:
        """Return a frame's sender and name."""

    def meaning(self, frame: Frame) -> str:
        """Return the content of a frame in words."""

    def news(self, frames: Sequence[LoggedFrame]) -> Iterable[LoggedFrame]:
        """Yield the frames that did not come cyclically."""

    def latest(self, frames: Sequence[LoggedFrame]) -> Iterator[LoggedFrame]:
        """Yield the last frame of each identifier that comes cyclically."""


# What is recorded of a bench, by the ability that records.


def _recorded(
    session: Session, record: Path | str | Wish, config: BenchConfig, *, is_real_time: bool
) -> AbstractContextManager[Any]:
    """Return a context manager in whose block a session is recorded.

    Raises:
        ConfigError: nothing records.
    """
    for module in given_to("record"):
        opened: AbstractContextManager[Any] = module.recorded(
            session, record, config, is_real_time=is_real_time
        )
        return opened
    raise ConfigError(f"record = {record}: nothing here records; leave it out")
