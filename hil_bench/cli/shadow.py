"""`hil-bench shadow`: the plant beside the machine, on the commands that the real valve gets."""

import argparse
import json
import math
import sys
from collections.abc import Iterator
from pathlib import Path

import can
import numpy as np

from hil_bench.cli.arguments import add_bench_arguments, load_bench_config
from hil_bench.cli.controller_side import check_one_bus
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.interruption import interruption
from hil_bench.config import BenchConfig
from hil_bench.errors import BusError, ConfigError
from hil_bench.recording.channels import TIME, Channel, Recording, recording_dtype
from hil_bench.recording.files import RecordingFile
from hil_bench.recording.frames import message_of, read_frames
from hil_bench.shadow import QUANTITIES, Residual, Sample, Shadow, Window
from hil_bench.transports.opening import open_can_bus
from hil_bench.units import BAR, MILLIMETRE, PERCENT, Unit

_DISPLAY: dict[str, Unit] = {"m": MILLIMETRE, "Pa": BAR, "-": PERCENT}
_POLL = 0.2  # how long a wait for frames may take [s], so that Ctrl-C is heard

_EXAMPLES = """\
examples:
  hil-bench shadow bench.toml -i socketcan -c can0
  hil-bench shadow bench.toml -i socketcan -c can0 --pressure-bar 5 --record residuals.csv
  hil-bench shadow bench.toml --log run.blf          the frames of a recording, as fast as it goes
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "shadow",
        description="Run the plant of a bench on the commands that a real valve gets, as heard on\n"
        "the bus, and show what sets the machine apart from it. Nothing is sent.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_bench_arguments(parser)
    parser.add_argument(
        "--log", type=Path, metavar="FILE", help="no bus: the frames of a recording"
    )
    parser.add_argument(
        "--duration", type=float, default=math.inf, metavar="S", help="until Ctrl-C by default"
    )
    parser.add_argument(
        "--horizon",
        type=float,
        default=0.5,
        metavar="S",
        help="the plant is set to what the sensors say this often, and predicts from there (0.5)",
    )
    for flag, quantity, unit, default in _THRESHOLDS:
        parser.add_argument(
            flag,
            type=float,
            default=default,
            metavar="X",
            help=f"RMS of a window that is too much for the {quantity} ({default:g} {unit})",
        )
    parser.add_argument(
        "--record", type=Path, metavar="FILE.csv", help="write each value beside the twin's"
    )
    parser.add_argument("--json", action="store_true", help="print JSON for a program to read")
    parser.set_defaults(run=run)


_THRESHOLDS = (
    ("--position-mm", "position", "mm", 1.0),
    ("--pressure-bar", "pressures", "bar", 3.0),
    ("--spool-percent", "spool", "%%", 3.0),
)


def run(args: argparse.Namespace) -> int:
    """Follow a machine, or a recording of one.

    Raises:
        ConfigError: both a recording and a bus are given.
    """
    _check_arguments(args)
    config = load_bench_config(args)
    check_one_bus(config, "shadow")
    if args.log is not None and ("interface" in args or "channel" in args):
        raise ConfigError("--log needs no bus; give either --log or -i and -c")
    limits = {
        "position": MILLIMETRE.to_si(args.position_mm),
        "P_A": BAR.to_si(args.pressure_bar),
        "P_B": BAR.to_si(args.pressure_bar),
        "spool_position": PERCENT.to_si(args.spool_percent),
    }
    shadow = Shadow(config, horizon=args.horizon)
    report = _Report(
        shadow, limits, is_quiet=args.quiet or args.json, keeps=args.record is not None
    )
    file = None if args.record is None else RecordingFile(args.record)
    try:
        source = _log(args.log) if args.log is not None else _bus(config)
        for message in source:
            shadow.take(message)
            report.take()
            if report.end >= args.duration:
                break
        if file is not None:
            file.write(report.recording())
    finally:
        if file is not None:
            file.close()
    return report.finish(as_json=args.json)


def _check_arguments(args: argparse.Namespace) -> None:
    for name in ("duration", "horizon", "position_mm", "pressure_bar", "spool_percent"):
        value = getattr(args, name)
        if not value > 0.0:
            raise ConfigError(f"--{name.replace('_', '-')} {value:g}: more than 0 is right")
    if not 0.02 <= args.horizon <= 60.0:
        raise ConfigError(f"--horizon {args.horizon:g}: 0.02 to 60 s is right")
    if args.record is not None and args.record.suffix.lower() != ".csv":
        raise ConfigError(f"--record {args.record}: give a file name that ends in .csv")


def _log(path: Path) -> Iterator[can.Message]:
    for logged in read_frames(path):
        yield message_of(logged)


def _bus(config: BenchConfig) -> Iterator[can.Message]:
    """Yield what comes on the bus, until Ctrl-C.

    Raises:
        BusError: the bus is lost.
    """
    bus, what = open_can_bus(
        config.bus.interface, config.bus.channel, config.bus.bitrate, config.bus.options
    )
    with bus, interruption() as interrupted:
        while not interrupted.requested:
            try:
                message = bus.recv(_POLL)
            except (can.CanError, OSError) as error:
                raise BusError(f"{what}: {error}") from error
            if message is not None:
                yield message


class _Report:
    """What is told of a shadow while it runs, and at its end."""

    def __init__(
        self, shadow: Shadow, limits: dict[str, float], *, is_quiet: bool, keeps: bool
    ) -> None:
        self.end = 0.0
        self._shadow = shadow
        self._limits = limits
        self._is_quiet = is_quiet
        self._keeps = keeps
        self._rows: list[Sample] = []
        self._windows: list[Window] = []

    def take(self) -> None:
        """Take out what the shadow found since the last call, and tell it."""
        shadow = self._shadow
        while shadow.samples:
            sample = shadow.samples.popleft()
            self.end = sample.time
            if self._keeps:
                self._rows.append(sample)
        while shadow.windows:
            window = shadow.windows.popleft()
            self._windows.append(window)
            if not self._is_quiet:
                print(self._line(window), flush=True)

    def recording(self) -> Recording:
        """Return all values side by side, a row a value; what a row does not bring is NaN."""
        names = dict.fromkeys((axis, quantity) for _, axis, quantity, _, _ in self._rows)
        channels = [
            Channel(f"{axis}.{quantity}{side}", QUANTITIES[quantity])
            for axis, quantity in names
            for side in ("", "_twin")
        ]
        table = np.full(len(self._rows), np.nan, dtype=recording_dtype([TIME, *channels]))
        for row, (time, axis, quantity, machine, twin) in zip(table, self._rows, strict=True):
            row["time"] = time
            row[f"{axis}.{quantity}"], row[f"{axis}.{quantity}_twin"] = machine, twin
        return table

    def finish(self, *, as_json: bool) -> int:
        """Tell the whole, and return the exit code."""
        worst = self._worst()
        exceeded = sum(
            any(self._exceeds(q, r) for q, r in w.residuals.items()) for w in self._windows
        )
        if as_json:
            print(json.dumps(self._content(worst, exceeded), indent=2))
        elif not self._windows:
            print(
                f"nothing to compare: {self._shadow.frames} frames heard, but not position and "
                "both pressures of one axis; are the nodes OPERATIONAL, is it their bench.toml?",
                file=sys.stderr,
            )
        else:
            print(self._summary(worst, exceeded))
        return ExitCode.DONE if self._windows and not exceeded else ExitCode.CHECK_FAILED

    def _worst(self) -> dict[str, dict[str, Residual]]:
        """Return, an axis, the window's residual of each quantity with the largest RMS."""
        worst: dict[str, dict[str, Residual]] = {}
        for window in self._windows:
            of_axis = worst.setdefault(window.axis, {})
            for quantity, residual in window.residuals.items():
                if residual.count and residual.rms >= of_axis.get(quantity, Residual(1)).rms:
                    of_axis[quantity] = residual
        return worst

    def _exceeds(self, quantity: str, residual: Residual) -> bool:
        return residual.rms > self._limits[quantity]

    def _line(self, window: Window) -> str:
        cells = []
        for quantity, residual in window.residuals.items():
            if residual.count:
                mark = " !" if self._exceeds(quantity, residual) else "  "
                cells.append(f"{quantity} {_text(quantity, residual.rms)}{mark}")
        return f"{window.end:8.2f} s  {window.axis}  {'  '.join(cells)}"

    def _summary(self, worst: dict[str, dict[str, Residual]], exceeded: int) -> str:
        lines = [f"\n{len(self._windows)} windows, {exceeded} of them beyond a limit; the worst:"]
        for axis, residuals in worst.items():
            for quantity, residual in residuals.items():
                verdict = "TOO MUCH" if self._exceeds(quantity, residual) else "ok"
                lines.append(
                    f"  {axis} {quantity:15} RMS {_text(quantity, residual.rms)}, largest "
                    f"{_text(quantity, residual.largest)}, limit "
                    f"{_text(quantity, self._limits[quantity])}: {verdict}"
                )
        return "\n".join(lines)

    def _content(self, worst: dict[str, dict[str, Residual]], exceeded: int) -> dict[str, object]:
        return {
            "frames": self._shadow.frames,
            "windows": len(self._windows),
            "exceeded": exceeded,
            "worst": {
                axis: {
                    quantity: {
                        "rms": residual.rms,
                        "largest": residual.largest,
                        "limit": self._limits[quantity],
                        "unit": QUANTITIES[quantity],
                    }
                    for quantity, residual in residuals.items()
                }
                for axis, residuals in worst.items()
            },
        }


def _text(quantity: str, value: float) -> str:
    unit = _DISPLAY[QUANTITIES[quantity]]
    return f"{unit.from_si(value):.3f} {unit.symbol}"
