"""What is recorded of a bench: one row of SI values a tick.

First what each axis does, then what each of its sensors measures, with the sensor's errors, delay
and noise. The spool is in fractions of the valve's full opening, as on the bus.
"""

from collections.abc import Callable, Iterable, Sequence
from datetime import UTC, datetime

import hil_bench
from hil_bench.bench import Bench
from hil_bench.canopen_device.frame import Frame
from hil_bench.config import BenchConfig
from hil_bench.recording.channels import Channel
from hil_bench.recording.formats import Heading
from hil_bench.recording.inline_recorder import RecordingSink
from hil_bench.transports.transport import Transport, TransportCounters

Exchange = Callable[[Sequence[Frame], int], Sequence[Frame]]
"""Takes received frames and the time [ns], and returns frames to send."""

AXIS_QUANTITIES = (
    ("position", "m"),
    ("speed", "m/s"),
    ("P_A", "Pa"),
    ("P_B", "Pa"),
    ("spool_setpoint", "-"),
    ("spool_position", "-"),
)


def bench_channels(bench: Bench) -> tuple[Channel, ...]:
    """Return the channels of a row of `sample`: `AXIS.QUANTITY`, then `SENSOR.measured`."""
    channels = [
        Channel(f"{axis.name}.{quantity}", unit)
        for axis in bench.axes
        for quantity, unit in AXIS_QUANTITIES
    ]
    channels += [Channel(f"{sensor.name}.measured", "Pa") for sensor in bench.pressures]
    for position in bench.positions:
        channels.append(Channel(f"{position.name}.measured", "m"))
        channels.append(Channel(f"{position.name}.measured_speed", "m/s"))
    return tuple(channels)


def sample(bench: Bench) -> list[float]:
    """Return the present values of all `bench_channels`, in their order."""
    row: list[float] = []
    for axis, u in zip(bench.axes, bench.commands, strict=True):
        output, full = axis.plant.output, axis.valve.full_opening
        row += (output.x, output.v, output.P_A, output.P_B, u / full, output.nu / full)
    row += [sensor.measured for sensor in bench.pressures]
    for position in bench.positions:
        row += (position.measured, position.measured_speed)
    return row


def recording_heading(config: BenchConfig, *, is_real_time: bool) -> Heading:
    """Return what a recording of a bench says of itself."""
    comment = (
        f"hil-bench {hil_bench.__version__}, {config.path or 'built-in bench'}, seed {config.seed}"
    )
    return Heading(comment, datetime.now(UTC) if is_real_time else None)


def record_exchange(
    exchange: Exchange, recording: RecordingSink, bench: Bench | None = None
) -> Exchange:
    """Return a bench's `tick` or `serve` that also records its frames, received ones first.

    Args:
        exchange: the bench's.
        recording: what takes signals and frames.
        bench: whose signals to record too, where time passes.
    """

    def exchange_and_record(frames: Sequence[Frame], now: int) -> Sequence[Frame]:
        sent = exchange(frames, now)
        recording.append_frames(frames, now, is_received=True)
        recording.append_frames(sent, now, is_received=False)
        if bench is not None:
            recording.append_row((now * 1e-9, *sample(bench)))
        return sent

    return exchange_and_record


class RecordingTap:
    """Records a bench on a bus: stands between both as the `Transport`, and observes each tick.

    Args:
        transport: the bus.
        recording: what takes signals and frames; its time 0 is the first tick.
    """

    def __init__(self, transport: Transport, recording: RecordingSink) -> None:
        self._transport = transport
        self._recording = recording
        self._frames: list[tuple[Sequence[Frame], bool]] = []
        self._start: int | None = None

    @property
    def description(self) -> str:
        """The bus for people."""
        return self._transport.description

    @property
    def has_exact_wait(self) -> bool:
        """Whether the bus can be waited on exactly."""
        return self._transport.has_exact_wait

    def receive(self, limit: int) -> list[Frame]:
        """Return what has arrived; see `Transport`."""
        received = self._transport.receive(limit)
        self._frames.append((received, True))
        return received

    def wait(self, timeout: float) -> bool:
        """Wait until a frame has arrived; see `Transport`."""
        return self._transport.wait(timeout)

    def send(self, frames: Sequence[Frame]) -> None:
        """Send frames."""
        self._frames.append((frames, False))
        self._transport.send(frames)

    def listen_to(self, can_ids: Iterable[int]) -> None:
        """Listen to all: a recording shows the whole bus, not only what is for the bench."""

    def counters(self) -> TransportCounters:
        """Return what passed."""
        return self._transport.counters()

    def close(self) -> None:
        """Close the bus."""
        self._transport.close()

    def observe(self, bench: Bench, now: int) -> None:
        """Record the tick that ends now."""
        if self._start is None:
            self._start = now
        time = now - self._start
        for frames, is_received in self._frames:
            self._recording.append_frames(frames, time, is_received=is_received)
        self._frames.clear()
        self._recording.append_row((time * 1e-9, *sample(bench)))
