"""A session in real time: joins it with a bus and a clock, and owns start and stop."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from hil_bench.bench.configuration import RealtimeConfig
from hil_bench.bench.session import Session
from hil_bench.canopen_device.frame import Frame
from hil_bench.canopen_device.sdo import QUEUE_LENGTH as SDO_QUEUE_LENGTH
from hil_bench.errors import BusError, ControllerError, TimingError
from hil_bench.outside.realtime.pacer import Pacer
from hil_bench.outside.realtime.scheduling import undisturbed
from hil_bench.outside.realtime.statistics import TickStatistics, TickSummary
from hil_bench.outside.transports.socketcan import SocketCanTransport
from hil_bench.outside.transports.transport import Transport, TransportCounters, outage_at_end

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

_VIRTUAL_CHANNELS = ("vcan", "vxcan")


@dataclass(frozen=True, slots=True)
class RunReport:
    """The result of a paced run.

    Attributes:
        ticks: statistics of the loop.
        frames: what passed the bus.
        lost: why the run ended early, None where it did not.
        statistics: of the loop, with its histograms.
        held: what the operating system gave the loop on request.
    """

    ticks: TickSummary
    frames: TransportCounters
    lost: BusError | ControllerError | TimingError | None
    statistics: TickStatistics
    held: Sequence[str] = ()


def run_paced(
    session: Session,
    transport: Transport,
    pacer: Pacer,
    *,
    stopped: Callable[[], bool],
    realtime: RealtimeConfig | None = None,
    serves_between_ticks: bool = True,
    hears_all: bool = False,
) -> RunReport:
    """Run a bench on a bus, tick by tick on the pacer's grid, until `stopped` says so.

    Bench time begins with the first tick. One thread owns bus and plant. A lost bus ends the run,
    and so does an overrun where the pacer is to stop then; the report says why. An interface that
    is down does not: it may come back.

    Args:
        session: the bench, not yet powered on.
        transport: the bus; it stays open.
        pacer: a new one, its grid not yet begun.
        stopped: asked once a tick.
        realtime: what to ask of the operating system; None for what needs no permission.
        serves_between_ticks: whether SDO requests are answered there too; that needs a pacer whose
            seconds are the bus's.
        hears_all: whether to take all frames of the bus, for who observes them, and not only those
            that the bench listens to. Each costs the loop time.
    """
    lost: BusError | ControllerError | TimingError | None = None
    with undisturbed(realtime or RealtimeConfig(), pacer.period) as held:
        try:
            takes_time = session.bench.medium is not None  # so do frames for others
            bus = _Bus(session, transport, pacer, hears_all=hears_all or takes_time)
            _loop(session, bus, pacer, stopped, serves_between_ticks=serves_between_ticks)
        except (BusError, ControllerError, TimingError) as error:
            lost = error
    lost = lost or outage_at_end(transport)
    ticks = pacer.statistics.summary()
    return RunReport(ticks, transport.counters(), lost, pacer.statistics, held)


def frames_per_tick(period: int) -> int:
    """Return the largest number of frames that a tick takes from the bus.

    It is never more than an SDO server can queue, so that a flood of requests is answered in full.

    Args:
        period: time between ticks [ns].
    """
    share = FRAMES_PER_MILLISECOND * period // _MILLISECOND
    return min(max(share, FRAMES_WHEN_LATE), SDO_QUEUE_LENGTH)


def _loop(
    session: Session,
    bus: "_Bus",
    pacer: Pacer,
    stopped: Callable[[], bool],
    *,
    serves_between_ticks: bool,
) -> None:
    for prepare in session.preparations:
        prepare()
    start = scheduled = pacer.wait()
    session.start()
    bus.listen()
    share = frames_per_tick(pacer.period)
    while not stopped():
        limit = share if pacer.lateness <= pacer.period else FRAMES_WHEN_LATE
        session.tick(bus.take(limit), scheduled - start, bus.send)
        pacer.done()
        if serves_between_ticks:
            bus.serve()
        scheduled = pacer.wait()


class _Bus:
    """The bus of a paced run: what ticks take from it, and what is served between them."""

    def __init__(
        self, session: Session, transport: Transport, pacer: Pacer, *, hears_all: bool
    ) -> None:
        self._session = session
        self._bench = session.bench
        self._transport = transport
        self._pacer = pacer
        self._hears_all = hears_all or session.bench.switchboard.hears_all
        # A driver of real hardware would send them as data frames.
        is_virtual = getattr(transport, "channel", "").startswith(_VIRTUAL_CHANNELS)
        self._reports_errors = is_virtual and isinstance(transport, SocketCanTransport)
        self._held: list[Frame] = []
        self._routes = session.bench.routes

    def listen(self) -> None:
        """Let the identifiers through that a bench listens to which has been powered on."""
        self._routes = self._bench.routes
        if not self._hears_all:
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
        medium = self._bench.medium
        if self._reports_errors and medium is not None and (errors := medium.reported()):
            self._transport.send(errors)

    def serve(self) -> None:
        """Answer SDO requests until shortly before the next tick, where the bus allows that.

        Nothing overtakes: a frame that is for the tick holds back what comes after it.
        """
        if not self._transport.has_exact_wait:
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
                self._session.serve(frames[:count], self.send)
            if self._held:
                return
