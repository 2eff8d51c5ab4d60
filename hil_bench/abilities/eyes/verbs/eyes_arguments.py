"""Arguments of the verbs that read frames: which nodes are known, and which lines are shown."""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from hil_bench.abilities.common.arguments import positive
from hil_bench.abilities.eyes.decoder import Decoder
from hil_bench.abilities.eyes.explain.bus import Language
from hil_bench.abilities.eyes.known_ecu import KnownEcu, ecus_of
from hil_bench.abilities.eyes.known_node import KnownNode, merge_nodes, node_of_eds, nodes_of
from hil_bench.abilities.eyes.sight import Service
from hil_bench.abilities.recording.frames import LeftOut
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.configuration.load import CONFIG_VARIABLE
from hil_bench.cli.arguments import BUILT_IN, add_bench_arguments
from hil_bench.cli.results import warn_of
from hil_bench.errors import ConfigError

_SHOWN = f"--eds alone, else {BUILT_IN}"
_NOT_ASSUMED = "the nodes of --eds alone"


def add_listening_arguments(parser: argparse.ArgumentParser, *, assumes: bool) -> None:
    """Add what says on which bus to listen, and which nodes are on it; see `known_nodes`."""
    add_bench_arguments(parser, otherwise=_SHOWN if assumes else _NOT_ASSUMED)
    parser.add_argument(
        "--on",
        metavar="NAME",
        help="use the bus of [buses.NAME] in a bench with several (default: that of [bus])",
    )
    add_eds_argument(parser)


def add_log_arguments(parser: argparse.ArgumentParser, *, assumes: bool) -> None:
    """Add the log of frames that is read, and which nodes are in it; see `known_nodes`."""
    parser.add_argument(
        "log",
        type=Path,
        metavar="FILE",
        help="log of frames: .log (candump), .asc, .blf, .trc or .mf4",
    )
    add_bench_arguments(parser, otherwise=_SHOWN if assumes else _NOT_ASSUMED)
    add_eds_argument(parser)


def add_eds_argument(parser: argparse.ArgumentParser) -> None:
    """Add --eds."""
    parser.add_argument(
        "--eds",
        action="append",
        default=[],
        metavar="N=FILE",
        help="EDS or DCF file of node N, as in 5=vendor.eds; repeat it for more nodes",
    )


def add_hold_argument(parser: argparse.ArgumentParser, where: str = "") -> None:
    """Add --hold, of values that are written; `where` says with which other option."""
    parser.add_argument(
        "--hold",
        type=positive,
        metavar="MS",
        help=f"{where}a value that is older is unknown (default: three times the shortest time "
        "between two values of its channel so far, and 100 at least)",
    )


def hold_of(args: argparse.Namespace) -> int | None:
    """Return the time for which a value counts [ns], None for the default."""
    return None if args.hold is None else round(args.hold * 1e6)


def add_filter_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what says which lines are shown, and how."""
    services = [service.value for service in Service]
    group = parser.add_argument_group("lines")
    group.add_argument(
        "--node",
        action="append",
        default=[],
        metavar="NAME",
        help="show only this node, by name or ID; repeat it for more",
    )
    for option, what in (
        ("--only", f"show only this kind of frames: {', '.join(services)}"),
        ("--hide", "hide this kind of frames"),
    ):
        group.add_argument(
            option, action="append", default=[], choices=services, metavar="KIND", help=what
        )
    group.add_argument(
        "--changes", action="store_true", help="hide frames that repeat the last content"
    )
    group.add_argument(
        "--problems", action="store_true", help="show only errors: aborts, EMCY, wrong lengths"
    )
    group.add_argument("--raw", action="store_true", help="show the bytes as well")
    group.add_argument(
        "--colour",
        choices=["auto", "always", "never"],
        default="auto",
        help="colour lines by service (default: auto, on a terminal)",
    )


def known_nodes(
    args: argparse.Namespace, config: BenchConfig, *, assumes: bool = False
) -> list[KnownNode]:
    """Return the nodes that the command line names: those of a bench, those of EDS files.

    Args:
        args: the command line.
        config: the bench; it counts where somebody has named it.
        assumes: whether the built-in bench counts where nobody has named anything; `say_assumed`
            says so. What is written, explained or
            missed must not rest on that.
    """
    counts = _is_named(args) or (assumes and not _has_files(args))
    return merge_nodes(nodes_of(config) if counts else (), map(node_of_eds, args.eds))


def say_assumed(args: argparse.Namespace, config: BenchConfig) -> None:
    """Say on standard error that the nodes are read as those of the built-in bench, if they are."""
    if not (_is_named(args) or _has_files(args) or args.quiet):
        numbers = ", ".join(str(node.node_id) for node in config.nodes)
        what = f"nodes {numbers} are read as those of the built-in bench"
        print(f"hil-bench: {what}; give bench.toml or --eds N=FILE for others", file=sys.stderr)


def say_language(
    args: argparse.Namespace, config: BenchConfig, language: Language, frames: int
) -> None:
    """Say on standard error that the bus is no CANopen, or else as which nodes it is read."""
    if not language.is_foreign:
        say_assumed(args, config)
    else:
        warn_of([*language.notes(frames)])


def _has_files(args: argparse.Namespace) -> bool:
    """Return True if files say what is on the bus."""
    return bool(args.eds) or getattr(args, "dbc", None) is not None


def _is_named(args: argparse.Namespace) -> bool:
    return args.config is not None or CONFIG_VARIABLE in os.environ


def known_ecus(args: argparse.Namespace, config: BenchConfig) -> list[KnownEcu]:
    """Return the J1939 devices of the bench that the command line names; see `known_nodes`."""
    return list(ecus_of(config)) if _is_named(args) else []


def check_nodes(names: Sequence[str], decoder: Decoder) -> None:
    """Refuse a --node that is neither a node-ID nor the name of a known node.

    Raises:
        ConfigError: it says which names there are.
    """
    known = sorted([*(node.name for node in decoder.nodes.values()), *decoder.ecus])
    for name in names:
        if not name.isdecimal() and name not in known:
            right = f"a node-ID or one of {', '.join(known)}" if known else "a node-ID"
            raise ConfigError(f"--node {name}: no node has this name; give {right}")


def print_losses(args: argparse.Namespace, left_out: LeftOut) -> None:
    """Say on standard error what of a log was not read."""
    for what in () if args.quiet else left_out.words():
        print(f"hil-bench: {args.log}: {what}", file=sys.stderr)
