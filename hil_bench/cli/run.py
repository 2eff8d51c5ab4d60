"""`hil-bench run`: the bench alone, on a bus that a controller joins."""

import argparse
import contextlib
import math
from collections.abc import Callable
from pathlib import Path

from hil_bench.assembly import build_bench
from hil_bench.bench import Bench
from hil_bench.cli import lockstep_run, paced_run
from hil_bench.cli.arguments import (
    add_bench_arguments,
    add_fault_arguments,
    add_loop_arguments,
    load_bench_config,
    read_speed,
)
from hil_bench.cli.bench_bus import HUB_CHANNEL, OpenBus, open_bus
from hil_bench.cli.collection import collection_put_off
from hil_bench.cli.device_table import device_table
from hil_bench.cli.doubts import warn_of
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.helpers import Helpers, add_loss_argument
from hil_bench.cli.histogram_file import HistogramFile
from hil_bench.cli.interruption import Interruption, interruption
from hil_bench.cli.lockstep_run import LockStepRun
from hil_bench.cli.loop_summary import helper_lines
from hil_bench.cli.modbus_side import NO_TIME_FOR_MODBUS, OpenModbus, open_modbus
from hil_bench.cli.paced_run import PacedRun, Surroundings
from hil_bench.cli.recording_arguments import (
    add_recording_arguments,
    check_recording_arguments,
    is_incomplete,
    open_recording,
    recording_lines,
)
from hil_bench.config import BenchConfig, FaultConfig
from hil_bench.config.plausibility import find_doubts
from hil_bench.errors import ConfigError
from hil_bench.realtime.clock import Clock, MonotonicClock, ScaledClock, VirtualClock
from hil_bench.recording.inline_recorder import RecordingSink
from hil_bench.transports.socketcand_hub import DEFAULT_PORT

_EXAMPLES = f"""\
examples:
  hil-bench run -i socketcan -c vcan0
  hil-bench run bench.toml -i socketcan -c can0 -b 500000 --duration 60
  hil-bench run -i socketcan -c can0 --realtime fifo --realtime-cpu 3
  hil-bench run -i socketcan -c vcan0 --record run.mf4
  hil-bench run -i socketcan -c vcan0 --modbus
                                       the sensors on Modbus TCP too, on port 5020
  hil-bench run -i socketcan -c vcan0 --fault freeze pressure_a at_s=10 for_s=2
  hil-bench run --hub                  a bus for other programs where there is no SocketCAN;
                                       they join it with: -i socketcand -c {HUB_CHANNEL}
                                       --bus-kwargs host=127.0.0.1 port={DEFAULT_PORT}
  hil-bench run -i virtual -c bench --speed max --duration 60 --record frozen.mf4
                --fault freeze pressure_a at_s=10
  hil-bench run -i socketcan -c vcan0 --lockstep --sync-period-us 2000 --record trace.log
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "run",
        description="Run the bench on a CAN bus, until Ctrl-C or --duration: in real time, or in\n"
        "lock-step with a controller, each SYNC of which moves the bench on by one period.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_bench_arguments(parser)
    add_loop_arguments(parser)
    add_fault_arguments(parser)
    parser.add_argument(
        "--duration", type=float, metavar="S", help="end after S seconds of bench time"
    )
    parser.add_argument(
        "--speed",
        type=read_speed,
        default=1.0,
        metavar="X",
        help="times real time (1), or max: as fast as this machine can, however slow others are",
    )
    parser.add_argument(
        "--hub",
        nargs="?",
        type=int,
        const=DEFAULT_PORT,
        metavar="PORT",
        help=f"host a bus on 127.0.0.1 in the socketcand protocol (default port {DEFAULT_PORT})",
    )
    parser.add_argument(
        "--hub-unlimited",
        action="store_true",
        help="with --hub: let a program send more than the bus's bit rate (-b, else 1 Mbit/s) "
        "carries; without it, it has to wait",
    )
    parser.add_argument(
        "--modbus",
        action="store_true",
        help="serve Modbus even where bench.toml has no [modbus]",
    )
    parser.add_argument(
        "--strict-timing",
        action="store_true",
        help=f"end with exit code {ExitCode.TIMING} if a tick overran",
    )
    parser.add_argument(
        "--histograms",
        type=Path,
        metavar="FILE",
        help="write the timing of the run as JSON, with the histograms of lateness and work",
    )
    add_lockstep_arguments(parser)
    add_recording_arguments(parser)
    add_loss_argument(parser)
    parser.set_defaults(run=run)


def add_lockstep_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what concerns a bench that the controller's SYNC moves."""
    group = parser.add_argument_group("lock-step")
    group.add_argument(
        "--lockstep",
        action="store_true",
        help="time passes with the controller's SYNC (0x080) only, as fast as both can",
    )
    group.add_argument(
        "--sync-period-us",
        type=int,
        metavar="US",
        help="how far each SYNC moves the bench (default: bench.sync_period_us, else one tick)",
    )


def run(args: argparse.Namespace) -> int:
    """Run the bench until it is told to stop, or its bus is lost.

    Raises:
        ConfigError: Modbus in lock-step.
    """
    check_arguments(args)
    config = load_bench_config(args, modbus=args.modbus)
    if args.lockstep and config.modbus is not None:
        raise ConfigError(f"--lockstep: {NO_TIME_FOR_MODBUS}")
    warn_of(find_doubts(config))
    with collection_put_off():
        bench = build_bench(config)
    with contextlib.ExitStack() as stack:
        wish = stack.enter_context(interruption())
        recording = None
        if not args.lockstep:
            opened = open_recording(args, config, bench, is_real_time=args.speed <= 1)
            recording = stack.enter_context(opened)
        histograms = stack.enter_context(HistogramFile(args.histograms))
        bus = stack.enter_context(open_bus(args, config))
        modbus = stack.enter_context(open_modbus(config, bench))
        if args.lockstep:
            return lock_step(args, config, bench, bus, wish)
        around = Surroundings(bus, modbus, recording, wish)
        announce = print_once(introduction(config, bus, modbus))
        run = PacedRun(args, config, bench, around, announce, clock_of(args.speed))
        report = run.run()
        histograms.write(report, config.tick_ns, bus.bitrate)
    announce()  # where not even one tick was asked for
    lines = paced_run.summary_lines(report, run, config, bench, bus) + recording_lines(recording)
    print("\n".join(lines), flush=True)
    if report.lost is not None:
        raise report.lost
    is_late = args.strict_timing and report.ticks.overruns > 0
    return exit_code(run.helpers, recording, wish, is_late=is_late)


def check_arguments(args: argparse.Namespace) -> None:
    """Refuse what cannot be meant.

    Raises:
        ConfigError: it says which option and what would be right.
    """
    if args.duration is not None and not 0 < args.duration < float("inf"):
        raise ConfigError(f"--duration {args.duration:g}: a positive number of seconds is right")
    if args.hub is not None and not 0 <= args.hub <= 65535:
        raise ConfigError(f"--hub {args.hub}: a port from 1 to 65535 is right, or 0 for a free one")
    if args.lockstep and args.speed != 1:
        raise ConfigError("--speed: in lock-step the controller's SYNC is the pace; leave it out")
    for option in ("strict_timing", "histograms", "realtime", "overrun"):
        if (args.lockstep or math.isinf(args.speed)) and getattr(args, option):
            flag, where = f"--{option.replace('_', '-')}", "in lock-step"
            where = where if args.lockstep else "at --speed max"
            raise ConfigError(f"{flag}: {where} there is no real time to miss; leave it out")
    check_recording_arguments(args)
    if args.hub_unlimited and (args.hub is None or args.lockstep):
        why = "in lock-step nothing is limited" if args.lockstep else "belongs to --hub"
        raise ConfigError(f"--hub-unlimited: {why}; leave it out")
    if args.hub is not None and ("interface" in args or "channel" in args):
        raise ConfigError("--hub makes a bus of its own; give either --hub or -i and -c")


def introduction(config: BenchConfig, bus: OpenBus, modbus: OpenModbus) -> str:
    """Return what a controller engineer needs to know to join."""
    source = config.path or "built-in bench"
    plant = f"{config.steps_per_tick} plant steps a tick" if config.axes else "no axis"
    rate = f"{1e9 / config.tick_ns:g} Hz, {plant}"
    lines = [f"bench  {source}, {rate}", *bus.lines]
    lines += modbus.lines
    lines += [f"fault  {fault_line(fault)}" for fault in config.faults]
    return "\n".join((*lines, "", device_table(config), ""))


def fault_line(fault: FaultConfig) -> str:
    """Return what a fault is, and when."""
    lasts = "" if fault.duration is None else f", for {fault.duration:g} s"
    return f"{fault.kind} {fault.target} at {fault.at:g} s{lasts}"


def clock_of(speed: float) -> Clock:
    """Return the clock of a run at some speed, which may be infinite."""
    if math.isinf(speed):
        return VirtualClock()
    return MonotonicClock() if speed == 1 else ScaledClock(MonotonicClock(), speed)


def lock_step(
    args: argparse.Namespace,
    config: BenchConfig,
    bench: Bench,
    bus: OpenBus,
    wish: Interruption,
) -> int:
    """Run in lock-step, print the summary and return the exit code."""
    run = LockStepRun(args, config, bench, bus.transport, wish)
    report = run.run(print_once(introduction(config, bus, OpenModbus())))
    lines = lockstep_run.summary_lines(report, config, bench) + recording_lines(run.recording)
    print("\n".join((*lines, *helper_lines(run.helpers.lines()))), flush=True)
    if report.lost is not None:
        raise report.lost
    return exit_code(run.helpers, run.recording, wish)


def exit_code(
    helpers: Helpers, recording: RecordingSink | None, wish: Interruption, *, is_late: bool = False
) -> int:
    """Return what a run ends with whose bus was not lost."""
    if helpers.is_incomplete or is_incomplete(recording):
        return ExitCode.LOST
    if is_late:
        return ExitCode.TIMING
    return ExitCode.INTERRUPTED if wish.requested else ExitCode.DONE


def print_once(text: str) -> Callable[[], None]:
    """Return what prints a text at its first call, and nothing later.

    The text is made before, when there is no tick yet to hold up.
    """
    left = [text]

    def announce() -> None:
        while left:
            print(left.pop(), flush=True)

    return announce
