"""`hil-bench boot`: boot a network as its NMT master."""

import argparse
import math
import sys
from pathlib import Path

from hil_bench.abilities.commissioning.boot_file import BootPlan, load_boot_plan, plan_of_bench
from hil_bench.abilities.common import arguments as common
from hil_bench.abilities.common.controller_side import open_network
from hil_bench.abilities.common.files import whole_file
from hil_bench.cli import arguments
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.results import add_json_argument, is_silent, print_lines, print_results
from hil_bench.errors import (
    ConfigError,
    about_file,
)
from hil_drivers import Network
from hil_drivers.boot import NetworkManager
from hil_drivers.boot_records import BootResult, Slave, Start
from hil_drivers.concise_dcf import pack_concise_dcf

_EXAMPLES = """\
examples:
  hil-bench boot --virtual                                         the built-in bench
  hil-bench boot -i socketcan -c can0 bench.toml                   the devices of a bench
  hil-bench boot -i socketcan -c can0 --network examples/network.toml --stay inf
                                                                   a network, until Ctrl-C
  hil-bench boot --network examples/network.toml --concise-dcf .   write files, send nothing
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "boot",
        description="Boot a CANopen network as its NMT master (CiA 302-2): reset, check device\n"
        "type and identity of each slave, configure it, wait for its heartbeat, start it.",
        epilog=_EXAMPLES,
    )
    arguments.add_bench_arguments(parser)
    common.add_network_arguments(parser)
    parser.add_argument(
        "--network",
        type=Path,
        metavar="FILE",
        help="the network list (docs/commissioning.md); without it the nodes of the bench, each "
        "mandatory, checked by its EDS and not configured",
    )
    parser.add_argument(
        "--stay",
        type=_duration,
        default=0.0,
        metavar="S",
        help="stay for S seconds, or inf: send the master's heartbeat, boot anew what is lost or "
        "comes late",
    )
    parser.add_argument(
        "--concise-dcf",
        type=Path,
        metavar="DIR",
        help="boot nothing: write the configuration of each slave as concise DCF (0x1F22) into DIR",
    )
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Boot the network; exit code 0 if it was started and, with --stay, was up to the end.

    1 where a mandatory slave is missing or reports another state, 6 where one reports no state.
    """
    config = arguments.load_bench_config(args)
    plan = load_boot_plan(args.network) if args.network else None
    if args.concise_dcf is not None:
        return _write_concise(args, plan)
    if plan is None:
        plan = plan_of_bench(common.seen_from_bus(args, config))
    with open_network(args, config) as opened:
        if not is_silent(args):
            print_lines(args, f"bus      {opened.description}")
        is_started, manager = _boot(args, opened.network, plan)
    results = list(manager.results.values())
    verdict = _verdict(manager, is_started=is_started)
    content = {
        "started": is_started,
        "slaves": [_content(result, manager) for result in results],
    }
    print_results(args, [f"network  {verdict}"], content)
    if not is_started:
        return ExitCode.CHECK_FAILED
    return ExitCode.INCONCLUSIVE if manager.unseen else ExitCode.DONE


def _boot(
    args: argparse.Namespace, network: Network, plan: BootPlan
) -> tuple[bool, NetworkManager]:
    def tell(line: str) -> None:
        if not is_silent(args):
            print_lines(args, line)

    manager = NetworkManager(network, plan.slaves, plan.startup, tell)
    if plan.heartbeat:
        network.start_heartbeat(plan.node_id, plan.heartbeat)
    is_started = manager.boot()
    if is_started and args.stay:
        try:
            is_started = manager.watch(args.stay)
        except KeyboardInterrupt:
            if not math.isinf(args.stay):
                raise
            print("ended by Ctrl-C; the slaves stay as they are", file=sys.stderr)
    return is_started, manager


def _duration(text: str) -> float:
    """Return a time to stay.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not seconds > 0.0:
        raise argparse.ArgumentTypeError(f"{text!r}: give a positive number of seconds, or inf")
    return seconds


def _verdict(manager: NetworkManager, *, is_started: bool) -> str:
    results = list(manager.results.values())
    missing = [result for result in results if not result.is_up]
    names = ", ".join(
        f"{result.slave} ({result.error.name})"
        for result in missing
        if result.error is not None and (is_started or result.slave.mandatory)
    )
    if manager.left_out:
        there = ", ".join(f"{s} is {_state(manager, s)}" for s in manager.left_out)
        return f"not started: mandatory {there}"
    if not is_started:
        return f"not started: mandatory {names}" if names else "not started"
    more = f" without {names}" if names else f", {len(results)} slaves"
    if manager.startup.start is Start.NONE:
        return f"booted{more}; the application starts it"
    if manager.unseen:
        return f"start commanded{more}; no state from {', '.join(map(str, manager.unseen))}"
    return f"started{more}"


def _state(manager: NetworkManager, slave: Slave) -> str:
    state = manager.states.get(slave.node_id)
    return state.name.replace("_", "-") if state else "not reported"


def _content(result: BootResult, manager: NetworkManager) -> dict[str, object]:
    return {
        "node_id": result.slave.node_id,
        "name": result.slave.name,
        "mandatory": result.slave.mandatory,
        "booted": result.is_up,
        "error": result.error.name if result.error else None,
        "meaning": result.error.value if result.error else None,
        "reason": result.reason or None,
        "configuration": result.configured.value,
        "state": _state(manager, result.slave),
    }


def _write_concise(args: argparse.Namespace, plan: BootPlan | None) -> int:
    """Write the concise DCF of each slave that has a configuration.

    Raises:
        ConfigError: there is no network list.
    """
    if plan is None:
        raise ConfigError("--concise-dcf: needs the configurations of a network; give --network")
    directory: Path = args.concise_dcf
    with about_file(f"--concise-dcf {directory}"):
        directory.mkdir(parents=True, exist_ok=True)
        for slave in plan.slaves:
            if slave.configuration:
                path = directory / f"{slave.name}.cdcf"
                with whole_file(path) as file:
                    file.write_bytes(pack_concise_dcf(slave.configuration))
                print_lines(args, f"{path}: {len(slave.configuration)} entries")
    return ExitCode.DONE
