"""Joins a bench with a bus and a clock, and owns start and stop."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from hil_bench.bench import Bench
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.sdo import QUEUE_LENGTH as SDO_QUEUE_LENGTH
from hil_bench.config import RealtimeConfig
from hil_bench.errors import BusError, TimingError
from hil_bench.realtime.pacer import Pacer
from hil_bench.realtime.scheduling import undisturbed
from hil_bench.realtime.statistics import TickStatistics, TickSummary
from hil_bench.transports.transport import Transport, TransportCounters, outage_at_end

FRAMES_PER_MILLISECOND = 32
"""Most frames taken from the bus in one tick, for each millisecond of its period: twice what a
1 Mbit/s bus can carry. What is more waits in the bus's own buffer."""

FRAMES_WHEN_LATE = 4
"""Most frames taken in a tick that starts later than its period is long. Such ticks follow back to
back until the loop is on time again, so a flood that this machine cannot keep up with costs
answers' latency and never a tick."""

TIME_OF_FRAME = 50_000
"""Time that it takes to serve a frame [ns], and more: what does not fit in before a tick waits."""

ROUNDS_BETWEEN_TICKS = 16
"""How often the bus is looked at between two ticks, each time for `FRAMES_WHEN_LATE` frames: a
flood of what nobody here listens to costs no more than that."""

_MILLISECOND = 1_000_000

Observer = Callable[[Bench, int], None]
"""Told the bench and the scheduled time [ns] at the end of each tick; must be short."""


@dataclass(frozen=True, slots=True)
class RunReport:
    """What a paced run did.

    Attributes:
        ticks: statistics of the loop.
        frames: what passed the bus.
        lost: why the run ended early, None where it did not.
        statistics: of the loop, with its histograms.
    """

    ticks: TickSummary
    frames: TransportCounters
    lost: BusError | TimingError | None
    statistics: TickStatistics


def run_paced(
    bench: Bench,
    transport: Transport,
    pacer: Pacer,
    *,
    stopped: Callable[[], bool],
    observers: Sequence[Observer] = (),
    realtime: RealtimeConfig | None = None,
    serves_between_ticks: bool = True,
) -> RunReport:
    """Run the bench on a bus, tick by tick on the pacer's grid, until `stopped` says so.

    One thread owns bus and plant. A lost bus ends the run, and so does an overrun where the pacer
    is to stop then; the report says why. An interface that is down does not: it may come back.

    Args:
        bench: not yet powered on.
        transport: the bus; it stays open.
        pacer: a new one, its grid not yet begun.
        stopped: asked once a tick.
        observers: called at the end of each tick.
        realtime: what to ask of the operating system; None for what needs no permission.
        serves_between_ticks: whether SDO requests are answered there too; that needs a pacer whose
            seconds are the bus's.
    """
    lost: BusError | TimingError | None = None
    with undisturbed(realtime or RealtimeConfig(), pacer.period):
        try:
            bus = _Bus(bench, transport, pacer, serves_between_ticks=serves_between_ticks)
            _loop(bench, bus, pacer, stopped, observers)
        except (BusError, TimingError) as error:
            lost = error
    lost = lost or outage_at_end(transport)
    return RunReport(pacer.statistics.summary(), transport.counters(), lost, pacer.statistics)


def frames_per_tick(period: int) -> int:
    """Return how many frames a tick takes from the bus at most.

    It is never more than an SDO server can queue, so that a flood of requests is answered in full.

    Args:
        period: time between ticks [ns].
    """
    share = FRAMES_PER_MILLISECOND * period // _MILLISECOND
    return min(max(share, FRAMES_WHEN_LATE), SDO_QUEUE_LENGTH)


def _loop(
    bench: Bench,
    bus: "_Bus",
    pacer: Pacer,
    stopped: Callable[[], bool],
    observers: Sequence[Observer],
) -> None:
    now = pacer.wait()
    bench.start(now)
    bus.listen()
    share = frames_per_tick(pacer.period)
    while not stopped():
        limit = share if pacer.lateness <= pacer.period else FRAMES_WHEN_LATE
        bus.send(bench.tick(bus.take(limit), now))
        for observe in observers:
            observe(bench, now)
        pacer.done()
        bus.serve(now)
        now = pacer.wait()


class _Bus:
    """The bus of a paced run: what ticks take from it, and what is served between them."""

    def __init__(
        self, bench: Bench, transport: Transport, pacer: Pacer, *, serves_between_ticks: bool
    ) -> None:
        self._bench = bench
        self._transport = transport
        self._pacer = pacer
        self._held: list[Frame] = []
        self._routes = bench.routes
        self._serves_between_ticks = serves_between_ticks and transport.has_exact_wait

    def listen(self) -> None:
        """Let the identifiers through that a bench listens to which has been powered on."""
        self._routes = self._bench.routes
        self._transport.listen_to(self._routes)

    def take(self, limit: int) -> list[Frame]:
        """Return the frames for a tick, the oldest first."""
        held, self._held = self._held, []
        return held + self._transport.receive(limit - len(held))

    def send(self, frames: Sequence[Frame]) -> None:
        """Listen to the identifiers that have changed meanwhile, and send frames.

        In this order: a master that has the answer may use the new identifier at once.
        """
        if self._bench.routes is not self._routes:
            self.listen()
        self._transport.send(frames)

    def serve(self, now: int) -> None:
        """Answer SDO requests until shortly before the next tick.

        Nothing overtakes: a frame that is for the tick holds back what comes after it.

        Args:
            now: time of the last tick [ns], at which the bench stands still.
        """
        if not self._serves_between_ticks:
            return
        for _ in range(ROUNDS_BETWEEN_TICKS):
            remaining = self._pacer.remaining()
            if remaining < TIME_OF_FRAME or not self._transport.wait(remaining * 1e-9):
                return
            room = self._pacer.remaining() // TIME_OF_FRAME
            frames = self._transport.receive(max(0, min(room, FRAMES_WHEN_LATE)))
            count = next(
                (n for n, frame in enumerate(frames) if not self._bench.is_timeless(frame)),
                len(frames),
            )
            self._held = frames[count:]
            if count:
                self.send(self._bench.serve(frames[:count], now))
            if self._held:
                return
