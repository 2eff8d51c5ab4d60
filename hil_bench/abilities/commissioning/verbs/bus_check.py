"""`hil-bench check --bus`: the devices on a bus against the bench's configuration."""

import argparse
import json
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from hil_bench.abilities.commissioning import comparison
from hil_bench.abilities.common.arguments import bus_words, seen_from_bus
from hil_bench.abilities.common.controller_side import open_network
from hil_bench.abilities.common.files import whole_file
from hil_bench.abilities.common.terminal import agrees
from hil_bench.bench.configuration import BenchConfig
from hil_bench.cli.exit_codes import verdict_code
from hil_bench.cli.results import print_lines
from hil_bench.errors import ConfigError, about_file
from hil_drivers import DriverError, Network


def check_bus(args: argparse.Namespace, config: BenchConfig) -> int:
    """Compare, and mend where that is asked for; exit code 0 if nothing differs any more."""
    seen = seen_from_bus(args, config)
    with open_network(args, config) as opened:
        differences = comparison.compare(opened.network, seen)
        _print_differences(differences, args)
        plans = comparison.plan_writes(opened.network, seen, differences)
        if args.node is not None:
            plans = [plan for plan in plans if plan.config.node_id == args.node]
        if args.dcf is not None:
            _write_dcf(args.dcf, plans)
        if args.apply and plans and _is_wanted(plans, args):
            _apply_all(opened.network, plans, store=args.store)
            differences = comparison.compare(opened.network, seen)
            if not args.quiet:
                print(_verdict(differences), file=sys.stderr)
    is_silent = sum(each.is_missing for each in differences) == len(seen.nodes)
    is_silent &= len(differences) == len(seen.nodes)
    return verdict_code(fails=bool(differences) and not is_silent, passes=not differences)


def _print_differences(
    differences: Sequence[comparison.Difference], args: argparse.Namespace
) -> None:
    if args.json:
        print(json.dumps([_as_json(difference) for difference in differences], indent=2))
        return
    for difference in differences:
        print_lines(args, f"{difference.what}; {_mending(difference, args)}")
    if not args.quiet:
        print(_verdict(differences), file=sys.stderr)


def _as_json(difference: comparison.Difference) -> dict[str, object]:
    key = difference.key
    return {
        "node_id": difference.node_id,
        "object": None if key is None else f"0x{key[0]:04X}.{key[1]:02X}",
        "right": difference.right,
        "what": difference.what,
        "mend": difference.mend.value,
    }


def _mending(difference: comparison.Difference, args: argparse.Namespace) -> str:
    """Return the command that mends a difference, or shows more of it."""
    words = ["hil-bench", "check" if difference.mend is comparison.Mend.WRITE else "scan"]
    if args.config:
        words.append(args.config)
    if difference.mend is comparison.Mend.WRITE:
        words.append("--bus")
    words += bus_words(args)
    if difference.mend is comparison.Mend.WRITE:
        return f"mend: {shlex.join([*words, '--apply', '--node', str(difference.node_id)])}"
    return f"look: {shlex.join([*words, '--nodes', str(difference.node_id)])}"


def _verdict(differences: Sequence[comparison.Difference]) -> str:
    count = len(differences)
    if not count:
        return "the bus is as the configuration says"
    return f"{count} difference{'' if count == 1 else 's'}"


def _write_dcf(directory: Path, plans: Sequence[comparison.Plan]) -> None:
    """Write the plans as files."""
    with about_file(f"--dcf {directory}"):
        directory.mkdir(parents=True, exist_ok=True)
        for plan in plans:
            path = directory / f"node{plan.config.node_id}.cdcf"
            with whole_file(path) as file:
                file.write_bytes(comparison.concise_dcf(plan))
            print(f"{path}: {len(plan.writes)} writes", file=sys.stderr)


def _is_wanted(plans: Sequence[comparison.Plan], args: argparse.Namespace) -> bool:
    """Show the plans and ask.

    Raises:
        ConfigError: there is nobody to ask.
    """
    for plan in plans:
        print(f"node {plan.config.node_id} ({plan.config.name}): to PRE-OPERATIONAL, then")
        for write in plan.writes:
            print(f"  {_assignment(write)}  {write.name}")
        if args.store:
            print("  0x1010.01 = save  (the node keeps its parameters)")
    if args.yes:
        return True
    if not sys.stdin.isatty():
        raise ConfigError(
            "--apply: needs a confirmation, and this is no terminal; "
            "give --yes to write without asking"
        )
    return agrees("write this? [y/N] ", "y", "yes")


def _assignment(write: comparison.Write) -> str:
    """Return a write as ``0x1800.05 = 20 (0x0014)``."""
    index, subindex = write.key
    raw = f"0x{write.raw[::-1].hex().upper()}"
    value = raw if len(raw) > 8 and isinstance(write.value, int) else f"{write.value:g} ({raw})"
    return f"0x{index:04X}.{subindex:02X} = {value}"


def _apply_all(network: Network, plans: Sequence[comparison.Plan], *, store: bool) -> None:
    """Write every plan.

    Raises:
        ConfigError: a device refused or fell silent; what was written before stays written.
        KeyboardInterrupt: it was interrupted; likewise.
    """
    for plan in plans:
        node_id = plan.config.node_id
        try:
            comparison.apply(network, plan, store=store)
        except DriverError as error:
            raise ConfigError(f"{error}; {_half_configured(node_id)}") from error
        except KeyboardInterrupt:
            print(f"interrupted; {_half_configured(node_id)}", file=sys.stderr)
            raise
    nodes = ", ".join(str(plan.config.node_id) for plan in plans)
    print(f"left in PRE-OPERATIONAL, until an NMT start: node {nodes}", file=sys.stderr)


def _half_configured(node_id: int) -> str:
    return (
        f"node {node_id} is half configured and in PRE-OPERATIONAL: the same command again "
        "completes it"
    )
