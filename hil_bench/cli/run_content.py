"""The `hil-bench run --json` output: the figures of the summary, for a program."""

from dataclasses import asdict

from hil_bench.bench.ecus import ecus_of
from hil_bench.cli.helpers import Helpers
from hil_bench.cli.histogram_file import figures
from hil_bench.cli.run_setup import RunSetup
from hil_bench.devices.faults.faults import Faults
from hil_bench.outside.recording.inline_recorder import RecordingSink
from hil_bench.outside.transports.bus_load import load_of
from hil_bench.session.lockstep import LockStepReport
from hil_bench.session.paced import RunReport

_S_PER_NS = 1e-9


def paced_content(
    report: RunReport, setup: RunSetup, helpers: Helpers, *, is_timed: bool
) -> dict[str, object]:
    """Return the figures of a run by the clock.

    Args:
        report: of the run.
        setup: the bench, and what was open around it.
        helpers: the processes beside the loop.
        is_timed: whether there was a time by which ticks were due.
    """
    period, bitrate = setup.config.tick_ns, setup.bus.bitrate
    elapsed = (report.ticks.ticks + report.ticks.skipped) * period
    timing = ("lateness", "work")
    loop = figures(report.ticks, period)
    return {
        "bench_time": elapsed * _S_PER_NS,
        "loop": {key: loop[key] for key in loop if is_timed or key not in timing},
        "held": list(report.held),
        "bus_load": load_of(report.frames.bits, elapsed, bitrate),
        "bitrate": bitrate,
        **_common(report, setup, helpers),
    }


def lockstep_content(
    report: LockStepReport, setup: RunSetup, helpers: Helpers
) -> dict[str, object]:
    """Return the figures of a run in lock-step.

    Args:
        report: of the run.
        setup: the bench, and what was open around it.
        helpers: the processes beside the loop.
    """
    return {
        "bench_time": report.now * _S_PER_NS,
        "wall_time": report.moved,
        "syncs": report.syncs,
        "sync_period": setup.config.sync_period_ns * _S_PER_NS,
        **_common(report, setup, helpers),
    }


def _common(
    report: RunReport | LockStepReport, setup: RunSetup, helpers: Helpers
) -> dict[str, object]:
    bench = setup.session.bench
    medium = bench.medium
    standing = (lambda _device: None) if medium is None else medium.standing
    return {
        "ended_by": None if report.lost is None else str(report.lost),
        "frames": asdict(report.frames) | {"for_nobody": bench.unrouted},
        "buses": {name: part.counters() for name, part in setup.bus.parts.items()},
        "faults": [
            {
                "time": event.time * _S_PER_NS,
                "kind": event.kind,
                "target": event.target,
                "begins": event.is_begin,
            }
            for event in bench.part(Faults).events
        ],
        "nodes": [
            {
                "name": settings.name,
                "node_id": node.node_id,
                "state": node.state.name.replace("_", "-"),
                "refused": node.counters,
                "can": standing(node),
                "storage_problem": node.storage_problem,
            }
            for settings, node in zip(setup.config.nodes, bench.nodes, strict=True)
        ],
        "ecus": [
            {
                "name": name,
                **ecu.standing(),
                "can": standing(ecu.ecu),
            }
            for name, ecu in ecus_of(bench).items()
        ],
        "recording": _recorded(setup.recording),
        "helpers": helpers.lines(),
    }


def _recorded(recording: RecordingSink | None) -> dict[str, object] | None:
    """Return the report of a recording, None where there is none."""
    if recording is None:
        return None
    report = recording.report
    return asdict(report) | {"is_complete": report.is_complete}
