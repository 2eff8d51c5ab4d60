"""`hil-bench demo`: a position controller moves the cylinder, without any set-up."""

import argparse
import contextlib
import importlib.util
import math
from pathlib import Path

from hil_bench.abilities.common.arguments import add_output_argument, check_one_bus
from hil_bench.abilities.common.block_file import CandumpFile, RecordingFile
from hil_bench.abilities.common.files import make_directory
from hil_bench.abilities.common.shown_units import display_unit
from hil_bench.abilities.demo.sensors import SensorBus
from hil_bench.abilities.demo.session import (
    CYCLE,
    DemoReport,
    DemoSession,
    TrackingError,
)
from hil_bench.abilities.modbus.serving import require_pymodbus
from hil_bench.abilities.recording import options
from hil_bench.abilities.recording.plot import plot_result
from hil_bench.bench.configuration import BenchConfig, load_config
from hil_bench.cli.arguments import read_speed
from hil_bench.cli.exit_codes import Ending, ExitCode, interruption
from hil_bench.cli.helpers import Helpers, add_loss_argument
from hil_bench.cli.paced_run import helper_lines, loop_lines
from hil_bench.cli.results import add_json_argument, is_silent, print_results
from hil_bench.cli.status_line import StatusLine
from hil_bench.errors import ConfigError
from hil_bench.outside.recording.channels import Recording

_LONGEST = 3600.0

_EXAMPLES = """\
examples:
  hil-bench demo
  hil-bench demo --duration 30 --output results
  hil-bench demo --speed 0.1            in slow motion
  hil-bench demo --speed max            as fast as the machine can
  hil-bench demo --sensors modbus       the valve on CANopen, the sensors on Modbus
  hil-bench demo --record demo.mf4      signals and frames while it runs
  hil-bench demo bench.toml             with your own cylinder or motor
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "demo",
        description="A position controller, written with the drivers only, moves the first axis "
        "of the bench\nalong a motion profile. Bench and controller meet on a bus inside this "
        "process.",
        epilog=_EXAMPLES,
    )
    parser.add_argument(
        "config",
        nargs="?",
        metavar="bench.toml",
        help="the bench (default: HIL_BENCH_CONFIG, else the built-in bench of one axis)",
    )
    parser.add_argument(
        "--duration",
        type=float,
        default=10.0,
        metavar="S",
        help="length of the motion in s (default: 10)",
    )
    add_output_argument(parser, "hil-bench-demo", "recording and plot")
    parser.add_argument(
        "--speed",
        type=read_speed,
        default=1.0,
        metavar="X",
        help="factor of real time, as in 0.1, or max (default: 1)",
    )
    parser.add_argument(
        "--sensors",
        choices=[bus.value for bus in SensorBus],
        default=SensorBus.CANOPEN.value,
        help="bus of the sensors; the valve is on CANopen (default: canopen)",
    )
    options.add_recording_arguments(parser)
    add_loss_argument(parser)
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the demo, leave its files, print its summary.

    Raises:
        ConfigError: the duration makes no sense.
    """
    if not 0 < args.duration <= _LONGEST:
        raise ConfigError(f"--duration {args.duration:g}: give more than 0, up to {_LONGEST:g} s")
    sensors = SensorBus(args.sensors)
    if sensors is SensorBus.MODBUS:
        require_pymodbus()
    config = load_config(args.config, modbus=sensors is SensorBus.MODBUS)
    check_one_bus(config, "demo")
    options.check_recording_arguments(args)
    make_directory(args.output)
    session = DemoSession(
        config,
        duration=args.duration,
        is_paced=math.isfinite(args.speed),
        speed=args.speed,
        sensors=sensors,
        recording=options.recording_wish(args),
    )
    ending = Ending(args)
    with contextlib.ExitStack() as stack:
        signals = stack.enter_context(RecordingFile(args.output / "demo.csv"))
        frames = stack.enter_context(CandumpFile(args.output / "demo.log"))
        wish = stack.enter_context(interruption())
        line = StatusLine(
            session.snapshot,
            [session.fields[:2], session.fields[2:]],  # time and set-point, then the axes
            statistics=session.statistics,
            wanted=not is_silent(args),
        )
        helpers = Helpers(
            [line] if line.is_shown else [],
            ends_on_loss=args.end_on_loss,
            has_lost_data=lambda: (
                options.recording_code(session.bench.recording) is not ExitCode.DONE
            ),
        )

        def stopped() -> bool:
            helpers.look()
            return wish.requested or helpers.is_over

        with line, contextlib.closing(helpers):
            report = session.run(stopped)
        recording = session.bench.signals
        files: dict[str, Path] = {}
        with ending.going_on():
            signals.write(recording)
            files["recording"] = signals.path
        with ending.going_on():
            frames.write_frames(session.bench.frames)
            files["frames"] = frames.path
    plot, problem = None, "none, it could not be written"
    with ending.going_on():
        plot, problem = draw(recording, args.output / "demo.png")
    recorded = session.bench.recording
    lines = [
        *summary_lines(report, config, session.axis.quantity.unit),
        *(f"{name:9} {path}" for name, path in files.items()),
        f"plot      {plot or problem}",
        *(() if recorded is None else options.report_lines(recorded)),
        *helper_lines(helpers.lines()),
    ]
    content = {
        "motion": report,
        "files": files | {"plot": plot},
        "recording": recorded,
        "helpers": helpers.lines(),
    }
    with ending.going_on():
        print_results(args, lines, content)
    ending.take(helpers.code, options.recording_code(recorded), wish.code)
    return ending.code


def summary_lines(report: DemoReport, config: BenchConfig, unit: str) -> list[str]:
    """Return the figures of a demo, a line a fact; errors in a unit of SI as it is displayed."""
    speed = report.bench_time / report.wall_time
    lines = [
        (
            f"motion    {report.bench_time:.1f} s in {report.wall_time:.1f} s, "
            f"{speed:.{0 if speed > 2 else 2}f} times real time"
        ),
        f"error     {error_text(report.error, unit)}",
        f"control   {report.cycles} cycles of {CYCLE * 1e3:g} ms, {report.overruns} left out",
    ]
    if report.ticks is not None:
        lines += loop_lines(report.ticks, config.tick_ns)
    return lines


def error_text(error: TrackingError, unit: str) -> str:
    """Return a tracking error [m, rad] in words."""
    if math.isnan(error.rms):
        return "none, the motion had not begun"
    shown = display_unit(unit)
    rms, most = (f"{shown.from_si(each):.3f} {shown.symbol}" for each in error)
    return f"RMS {rms}, max {most}"


def draw(recording: Recording, path: Path) -> tuple[Path | None, str]:
    """Draw the recording; return where, or None and what is missing for it."""
    if importlib.util.find_spec("matplotlib") is None:
        return None, "none, matplotlib is missing: pip install 'hil-bench[plot]'"
    plot_result(recording, path, title="Position control over CANopen")
    return path, ""
