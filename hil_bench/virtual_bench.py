"""A bench on an embedded bus, with its traces: what tests, notebooks and the demo run.

>>> bench = VirtualBench(load_config("bench.toml"))
>>> bench.run(0.5)
>>> bench.signals["axis1.position"]
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from types import TracebackType
from typing import NamedTuple, Self

from hil_bench.assembly import build_bench
from hil_bench.canopen_device.frame import Frame
from hil_bench.config import BenchConfig, load_config
from hil_bench.errors import WaitTimeoutError
from hil_bench.realtime.pacer import Pacer
from hil_bench.recording.channels import Channel, ChannelRecorder, Recording
from hil_bench.telemetry import bench_channels, sample
from hil_bench.transports.embedded import EmbeddedBus

RECORDED_TIME = 60.0
"""Bench time that `VirtualBench.signals` reaches back unless told otherwise [s]."""

LOGGED_FRAMES = 100_000
"""Frames that `VirtualBench.frames` reaches back unless told otherwise."""


class LoggedFrame(NamedTuple):
    """A frame that was on the bus.

    Attributes:
        frame: the frame.
        now: bench time of the tick that received or sent it [ns].
        is_received: whether the bench received it; otherwise the bench sent it.
    """

    frame: Frame
    now: int
    is_received: bool


class VirtualBench:
    """A powered-on bench in virtual time, in the caller's thread.

    Bench time advances only in `run`, in `run_until` and while somebody waits in `bus.recv`.

    Args:
        config: the bench; without it the built-in one of one axis.
        recorded_time: how far `signals` reaches back [s].
        logged_frames: how many frames `frames` reaches back.
        pacer: holds the ticks back to real time; without it they follow at once.
        stimuli: what else to record, each a function of bench time [s], such as a set-point.

    Attributes:
        config: as passed in.
        bench: axes and nodes.
        bus: the controller's end of the bus, a python-can bus.
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
    ) -> None:
        self.config = config or load_config()
        self.bench = build_bench(self.config)
        self.frames: deque[LoggedFrame] = deque(maxlen=logged_frames)
        self.observers: list[Callable[[float], None]] = []
        stimuli = stimuli or {}
        self._stimuli = tuple(stimuli.values())
        rows = max(1, round(recorded_time * 1e9 / self.config.tick_ns))
        self._recorder = ChannelRecorder((*stimuli, *bench_channels(self.bench)), rows)
        self.bench.start(0)
        self.bus = EmbeddedBus(self._tick, self.config.tick_ns, pacer=pacer)
        self.pump: Callable[[float], None] = self.bus.advance

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.bus.shutdown()

    @property
    def signals(self) -> Recording:
        """What the plant did so far, a row a tick: `time` [s] first, then the channels in SI."""
        return self._recorder.result()

    def now(self) -> float:
        """Return the bench time [s]."""
        return self.bus.now()

    def run(self, duration: float) -> None:
        """Let bench time pass.

        Args:
            duration: how much [s].
        """
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
        """
        start = self.now()
        ticks = round(timeout * 1e9 / self.config.tick_ns)
        for _ in range(ticks):
            if condition():
                return self.now() - start
            self.pump(self.config.tick_ns * 1e-9)
        if condition():
            return self.now() - start
        raise WaitTimeoutError(f"condition not met within {timeout:g} s of bench time")

    def _tick(self, frames: Sequence[Frame], now: int) -> Sequence[Frame]:
        sent = self.bench.tick(frames, now)
        self.frames.extend(LoggedFrame(frame, now, is_received=True) for frame in frames)
        self.frames.extend(LoggedFrame(frame, now, is_received=False) for frame in sent)
        time = now * 1e-9
        stimuli = [stimulus(time) for stimulus in self._stimuli]
        self._recorder.append((time, *stimuli, *sample(self.bench)))
        for observe in self.observers:
            observe(time)
        return sent
