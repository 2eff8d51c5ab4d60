"""`hil-bench panel`: a running bench as a web page."""

import argparse
import ipaddress
import os
from pathlib import Path

from hil_bench.abilities.common.shown_units import add_units_argument
from hil_bench.abilities.live.ctl import add_bench_argument
from hil_bench.abilities.panel import DEFAULT_PORT
from hil_bench.abilities.panel.layouts import read_layout
from hil_bench.cli.exit_codes import ExitCode, interruption
from hil_bench.cli.results import print_lines
from hil_bench.errors import ConfigError

_NICENESS = 5
_EXAMPLES = """\
examples:
  hil-bench panel
  hil-bench panel --bench bench-2 --port 9000
  hil-bench panel --tests tests/scenarios       where "Record as a test" writes
  hil-bench panel --listen 192.0.2.7 --password-file panel.password
                                                for other machines too; without encryption
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "panel",
        description="Serve a web page on which people watch a bench that runs on this machine,\n"
        "set it and break it, until Ctrl-C. When the bench ends, it waits for the next start.",
        epilog=_EXAMPLES,
    )
    add_bench_argument(parser)
    parser.add_argument(
        "--port",
        type=int,
        metavar="PORT",
        help=f"port (default: {DEFAULT_PORT}, or a free one if it is in use; 0: a free one)",
    )
    parser.add_argument(
        "--listen",
        metavar="ADDRESS",
        help="address that other machines may reach (default: 127.0.0.1); needs --password-file",
    )
    parser.add_argument(
        "--password-file",
        type=Path,
        metavar="FILE",
        help="file with the page's password, readable by its owner only",
    )
    parser.add_argument(
        "--tests",
        type=Path,
        default=Path(),
        metavar="FOLDER",
        help='folder for scenarios of "Record as a test", and for recordings (default: this one)',
    )
    parser.add_argument(
        "--layout",
        type=Path,
        metavar="FILE",
        help="layout that pages open first, a NAME.layout.toml",
    )
    parser.add_argument(
        "--once",
        action="store_true",
        help="exit when the bench ends, or if the bench of --bench does not run",
    )
    add_units_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Serve the page.

    Raises:
        ConfigError: a library is missing, or an argument is wrong.
    """
    check_arguments(args)
    try:
        from hil_bench.abilities.panel.server import (  # noqa: PLC0415 - it needs an extra
            LOOPBACK,
            PanelPlan,
            read_password,
            run_panel,
        )
    except ImportError as error:
        raise ConfigError(
            f"panel needs {error.name}, which is missing; pip install 'hil-bench[panel]'"
        ) from None
    plan = PanelPlan(
        args.bench,
        args.listen or LOOPBACK,
        args.port,
        read_password(args.password_file) if args.password_file else "",
        args.tests.resolve(),
        args.once,
        args.layout and args.layout.resolve(),
    )
    if hasattr(os, "nice"):
        os.nice(_NICENESS)
    with interruption() as wish:
        run_panel(
            plan,
            lambda address: print_lines(args, f"panel  {address}"),
            lambda: wish.requested,
        )
    return ExitCode.DONE


def check_arguments(args: argparse.Namespace) -> None:
    """Refuse what cannot be meant.

    Raises:
        ConfigError: it says which option and what would be right.
    """
    if args.port is not None and not 0 <= args.port <= 65535:
        raise ConfigError(f"--port {args.port}: give 1 to 65535, or 0 for a free one")
    if args.layout is not None:
        read_layout(args.layout)
    if not args.tests.is_dir():
        raise ConfigError(f"--tests {args.tests}: there is no such folder; make it first")
    if args.listen is None:
        return
    try:
        address = ipaddress.ip_address(args.listen)
    except ValueError:
        raise ConfigError(f"--listen {args.listen}: give an IP address of this machine") from None
    if not address.is_loopback and args.password_file is None:
        raise ConfigError(
            f"--listen {args.listen}: others could come; give --password-file FILE too"
        )
