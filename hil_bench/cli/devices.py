"""`hil-bench devices`: what is on the bus, without opening one."""

import argparse
import json
from dataclasses import asdict

from hil_bench.cli.arguments import add_bench_arguments, load_bench_config
from hil_bench.cli.device_table import device_table, read_devices, read_ecus
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.results import add_json_argument, print_lines

_EXAMPLES = """\
examples:
  hil-bench devices                     the built-in bench
  hil-bench devices bench.toml
  hil-bench devices bench.toml --json
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "devices",
        description="Print the device table: node-ID, profile, EDS file and the PDOs of each node\n"
        "at power-on, with identifier, transmission type, timer and mapped objects; address and\n"
        "parameter groups of each J1939 device.",
        epilog=_EXAMPLES,
    )
    add_bench_arguments(parser)
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the device table."""
    config = load_bench_config(args)
    if args.json:
        rows = [asdict(device) for device in read_devices(config)]
        rows += [asdict(ecu) for ecu in read_ecus(config)]
        print(json.dumps(rows, indent=2))
    else:
        print_lines(args, device_table(config))
    return ExitCode.DONE
