"""Measurement of this machine's lateness in waking the bench's loop."""

from typing import NamedTuple

from hil_bench.bench.assembly import build_bench
from hil_bench.bench.bench import Bench
from hil_bench.bench.configuration import BenchConfig, RealtimeConfig, RealtimePolicy
from hil_bench.outside.realtime.clock import Clock
from hil_bench.outside.realtime.pacer import Pacer
from hil_bench.outside.realtime.statistics import TickSummary
from hil_bench.outside.transports.silent import SilentTransport
from hil_bench.session.paced import run_paced
from hil_bench.session.session import Session


class LatenessTest(NamedTuple):
    """One measurement.

    Attributes:
        name: how `hil-bench run` is called to run like this.
        summary: what the loop did.
    """

    name: str
    summary: TickSummary


def measure_lateness(
    config: BenchConfig, seconds: float, policies: list[RealtimePolicy], clock: Clock
) -> list[LatenessTest]:
    """Measure the lateness of the whole bench on a silent bus, once with each policy.

    Args:
        config: the bench.
        seconds: length of all together [s].
        policies: those to try.
        clock: the clock to wait on.
    """
    ticks = max(round(seconds / len(policies) * 1e9 / config.tick_ns), 1)
    names = {RealtimePolicy.OFF: "run"}
    return [
        LatenessTest(
            names.get(policy, f"run --realtime {policy.value}"),
            _run(build_bench(config), Pacer(clock, config.tick_ns), policy, ticks),
        )
        for policy in policies
    ]


def _run(bench: Bench, pacer: Pacer, policy: RealtimePolicy, ticks: int) -> TickSummary:
    return run_paced(
        Session(bench),
        SilentTransport(),
        pacer,
        stopped=lambda: pacer.statistics.ticks + pacer.statistics.skipped >= ticks,
        realtime=RealtimeConfig(policy=policy),
    ).ticks
