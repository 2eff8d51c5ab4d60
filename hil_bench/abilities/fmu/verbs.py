"""`hil-bench export-fmu`: an axis as an FMU for co-simulation."""

import argparse
from pathlib import Path

from hil_bench.abilities.common.progress import (
    Work,
    shown_work,
)
from hil_bench.abilities.common.together import axes_with
from hil_bench.abilities.fmu.export import export_axis, validate
from hil_bench.bench.configuration import AxisConfig, BenchConfig, load_config
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.errors import ConfigError

_EXAMPLES = """\
examples:
  hil-bench export-fmu axis.fmu                            the built-in axis
  hil-bench export-fmu axis.fmu bench.toml --axis axis2

The FMU runs in a Python that has hil-bench: in FMPy, and in tools that bring a Python.

exit code 1 where FMPy finds an error in it
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "export-fmu",
        description="Write an axis of a bench as an FMU for co-simulation (FMI 2.0): inputs are "
        "its command,\nload and supply pressure, outputs all of its quantities, in SI. Axes "
        "that share a supply\nare exported together.",
        epilog=_EXAMPLES,
    )
    parser.add_argument("fmu", type=Path, metavar="FMU", help="file to write")
    parser.add_argument(
        "config", nargs="?", metavar="BENCH.toml", help="the bench (default: the built-in one)"
    )
    parser.add_argument("--axis", metavar="NAME", help="axis to export (default: the first)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the FMU and check it."""
    config = load_config(args.config)
    axis = _find_axis(config, args.axis)
    with shown_work(args, Work("export-fmu")) as work:
        work.begin("writing")
        export_axis(config, axis, args.fmu)
        work.begin("checking")
        problems = validate(args.fmu)
    size = args.fmu.stat().st_size / 1e6
    axes = axes_with(config, axis)
    what = " and ".join(f"{each.name}, a {each.kind.name}" for each in axes)
    print(f"wrote {args.fmu}: {what}, {size:.1f} MB")
    for problem in problems:
        print(f"{args.fmu}: {problem}")
    return ExitCode.CHECK_FAILED if problems else ExitCode.DONE


def _find_axis(config: BenchConfig, name: str | None) -> AxisConfig:
    """Return the axis of a name; the first without one.

    Raises:
        ConfigError: there is none.
    """
    if name is None:
        return config.first_axis
    axes = {axis.name: axis for axis in config.axes}
    if name not in axes:
        raise ConfigError(f"--axis {name}: is no axis of this bench; give {' or '.join(axes)}")
    return axes[name]
