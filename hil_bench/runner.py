"""Joins a bench with a bus and a clock, and owns start and stop."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from hil_bench.bench import Bench
from hil_bench.canopen_device.sdo import QUEUE_LENGTH as SDO_QUEUE_LENGTH
from hil_bench.config import RealtimeConfig
from hil_bench.errors import BusError, TimingError
from hil_bench.realtime.pacer import Pacer
from hil_bench.realtime.scheduling import undisturbed
from hil_bench.realtime.statistics import TickSummary
from hil_bench.transports.transport import Transport, TransportCounters

FRAMES_PER_MILLISECOND = 32
"""Most frames taken from the bus in one tick, for each millisecond of its period: twice what a
1 Mbit/s bus can carry. What is more waits in the bus's own buffer."""

FRAMES_WHEN_LATE = 4
"""Most frames taken in a tick that starts later than its period is long. Such ticks follow back to
back until the loop is on time again, so a flood that this machine cannot keep up with costs
answers' latency and never a tick."""

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
    """

    ticks: TickSummary
    frames: TransportCounters
    lost: BusError | TimingError | None


def run_paced(
    bench: Bench,
    transport: Transport,
    pacer: Pacer,
    *,
    stopped: Callable[[], bool],
    observers: Sequence[Observer] = (),
    realtime: RealtimeConfig | None = None,
) -> RunReport:
    """Run the bench on a bus, tick by tick on the pacer's grid, until `stopped` says so.

    One thread owns bus and plant. A lost bus ends the run, and so does an overrun where the pacer
    is to stop then; the report says why.

    Args:
        bench: not yet powered on.
        transport: the bus; it stays open.
        pacer: a new one, its grid not yet begun.
        stopped: asked once a tick.
        observers: called at the end of each tick.
        realtime: what to ask of the operating system; None for what needs no permission.
    """
    lost = None
    with undisturbed(realtime or RealtimeConfig(), pacer.period):
        try:
            _loop(bench, transport, pacer, stopped, observers)
        except (BusError, TimingError) as error:
            lost = error
    return RunReport(pacer.statistics.summary(), transport.counters(), lost)


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
    transport: Transport,
    pacer: Pacer,
    stopped: Callable[[], bool],
    observers: Sequence[Observer],
) -> None:
    now = pacer.wait()
    bench.start(now)
    routes = bench.routes
    transport.listen_to(routes)
    share = frames_per_tick(pacer.period)
    while not stopped():
        limit = share if pacer.lateness <= pacer.period else FRAMES_WHEN_LATE
        transport.send(bench.tick(transport.receive(limit), now))
        if bench.routes is not routes:
            routes = bench.routes
            transport.listen_to(routes)
        for observe in observers:
            observe(bench, now)
        pacer.done()
        now = pacer.wait()
