"""`hil-bench conformance`: does a device keep to CiA 301 and CiA 305."""

import argparse
import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path

from hil_bench.abilities.common import arguments as common
from hil_bench.abilities.common.controller_side import OpenNetwork, open_network
from hil_bench.abilities.common.files import check_place, whole_file
from hil_bench.abilities.common.progress import Work, shown_work
from hil_bench.abilities.conformance import report
from hil_bench.abilities.conformance.check import Impact
from hil_bench.abilities.conformance.device import DeviceUnderTest
from hil_bench.abilities.conformance.eds_check import check_eds
from hil_bench.abilities.conformance.suite import Outcome, Result, planned, run_suite
from hil_bench.abilities.conformance.verdicts import Deviation, Silence
from hil_bench.abilities.conformance.wire import LATEST, Wire
from hil_bench.bench.configuration import BenchConfig
from hil_bench.bench.configuration.nodes_section import warn_of_findings
from hil_bench.canopen_device.eds import load_eds
from hil_bench.canopen_device.nmt import NmtCommand
from hil_bench.cli import arguments
from hil_bench.cli.exit_codes import Ending, ExitCode
from hil_bench.cli.results import add_json_argument, json_text
from hil_bench.errors import ConfigError, about_file

_EXAMPLES = """\
examples:
  hil-bench conformance -i socketcan -c can0 --node-id 5 --eds vendor.eds
  hil-bench conformance -i socketcan -c can0 --node-id 5 --eds vendor.eds --write --report device.md
  hil-bench conformance --virtual --node-id 1 --write

exit code 0 where no check failed, 1 where one did, 6 where the device does not answer; a
recommendation that the device does not follow is no failure

Each check has a degree: required of every device, optional (a device without the service is "not
applicable"), recommended. Where the device leaves OPERATIONAL by an error of its own, or answers no
more, one check fails and names the cause; those that need it are "not run".

Without --write nothing is written and no state changes. With it the node is reset, started and
stopped, its objects are written and restored, its RPDOs are sent: only where nothing can move. It
is left in PRE-OPERATIONAL with its power-on values.
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "conformance",
        description="Check a device on a bus, clause by clause, against CiA 301 and CiA 305, and\n"
        "print one line per check. The EDS file gives the device's objects and services.",
        epilog=_EXAMPLES,
    )
    arguments.add_bench_arguments(parser)
    common.add_network_arguments(parser)
    parser.add_argument("--node-id", type=int, required=True, metavar="N", help="of the device")
    parser.add_argument(
        "--eds",
        type=Path,
        metavar="FILE",
        help="EDS file of the device (default: that of bench.toml)",
    )
    parser.add_argument(
        "--write", action="store_true", help="also run the checks that change the device, see below"
    )
    parser.add_argument(
        "--store",
        action="store_true",
        help="also run those that overwrite stored parameters (0x1010, 0x1011); needs --write",
    )
    parser.add_argument(
        "--patience",
        type=float,
        default=0.5,
        metavar="S",
        help="time-out of an answer in s, and time that counts as silence (default: 0.5)",
    )
    parser.add_argument(
        "--report",
        type=Path,
        metavar="FILE.md",
        help="write a report in the order of CiA's test plan",
    )
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the checks and tell what was found."""
    config = arguments.load_bench_config(args)
    seen = common.seen_from_bus(args, config)
    allowed = _allowed(args)
    node_id = _node_id(args)
    eds = _eds(args, seen)
    objects = load_eds(eds, node_id)
    if args.eds is not None:  # what bench.toml names is warned of already
        warn_of_findings(args.eds, objects.findings)
    with open_network(args, config) as opened:
        wire = Wire(opened.network.bus, opened.network.now)
        dut = DeviceUnderTest(wire, node_id, objects, args.patience)
        checks = Work("conformance", len(planned(allowed)), "checks")
        checks.stage = f"node {node_id} is listened to and asked"
        with shown_work(args, checks, pauses=not args.json):
            code = _hear(dut, opened)
            if code is not ExitCode.DONE:
                return code
            with _reset_afterwards(dut, allowed):
                results = _run_checks(args, dut, allowed, checks)
                device = _description(dut)
    ending = Ending(args)
    ending.take(ExitCode.CHECK_FAILED if report.failures(results) else ExitCode.DONE)
    with ending.going_on():
        _print(results, args)
    if args.report is not None:
        with ending.going_on():
            _write_report(results, args, device, allowed, eds)
    return ending.code


def _run_checks(
    args: argparse.Namespace, dut: DeviceUnderTest, allowed: Impact, work: Work
) -> list[Result]:
    """Run the checks, print each result as it comes, and return all."""
    stages = (check.text for check in planned(allowed))
    results: list[Result] = []
    work.stage = next(stages)
    for result in run_suite(dut, allowed):
        results.append(result)
        work.done += 1
        work.stage = next(stages, "")
        is_shown = result.outcome is not Outcome.NOT_RUN
        if is_shown and not args.json and not args.quiet:
            print(report.line(result), flush=True)
    return results


@contextlib.contextmanager
def _reset_afterwards(dut: DeviceUnderTest, allowed: Impact) -> Iterator[None]:
    """Leave a device that checks have changed with its power-on values, also after Ctrl-C.

    Yields:
        Nothing.
    """
    try:
        yield
    finally:
        if allowed >= Impact.WRITE:
            dut.command(NmtCommand.RESET_NODE)
            print(f"node {dut.node_id} was reset, to its power-on values", file=sys.stderr)


def _allowed(args: argparse.Namespace) -> Impact:
    """Return the most that a check may do.

    Raises:
        ConfigError: options that do not go together, or make no sense.
    """
    if args.store and not args.write:
        raise ConfigError("--store: overwrites what the device has stored; give --write, too")
    if not 0.0 < args.patience < 60.0:
        raise ConfigError(f"--patience {args.patience:g}: give more than 0 and less than 60 s")
    if args.report is not None:
        if args.report.suffix.lower() in {".html", ".htm"}:
            raise ConfigError(f"--report {args.report}: the report is Markdown; give FILE.md")
        check_place("--report", args.report)
    if args.store:
        return Impact.STORE
    return Impact.WRITE if args.write else Impact.READ


def _node_id(args: argparse.Namespace) -> int:
    """Return the node-ID.

    Raises:
        ConfigError: it is none.
    """
    node_id = int(args.node_id)
    if not 1 <= node_id <= 127:
        raise ConfigError(f"--node-id {node_id}: give 1 to 127")
    return node_id


def _eds(args: argparse.Namespace, config: BenchConfig) -> Path:
    """Return the EDS of the device.

    Raises:
        ConfigError: neither the command line nor the configuration gives one.
    """
    if args.eds is not None:
        return Path(args.eds)
    for node in config.nodes:
        if node.node_id == args.node_id:
            return Path(node.eds)
    raise ConfigError(
        f"no --eds, and {config.path or 'the built-in bench'} has no such node; give --eds FILE"
    )


def _hear(dut: DeviceUnderTest, opened: OpenNetwork) -> ExitCode:
    """Return the exit code of a first question; print advice where it is not answered."""
    opened.network.pump(dut.patience if opened.virtual is None else 0.1)
    try:
        dut.sdo.upload(0x1000)
    except Deviation as deviation:
        is_silent = isinstance(deviation, Silence)
        advice = (
            "is it powered, not STOPPED, and the bit rate right? hil-bench scan shows who is there"
        )
        if is_silent and dut.sdo.catches_up(LATEST) and dut.sdo.delay:
            advice = f"one came after {dut.sdo.delay:.2f} s: give a longer --patience"
        print(
            f"node {dut.node_id} on {opened.description}: 0x1000.00 cannot be read: {deviation}; "
            f"{advice}",
            file=sys.stderr,
        )
        return ExitCode.INCONCLUSIVE if is_silent else ExitCode.CHECK_FAILED
    if dut.sdo.answers_twice():
        print(
            f"node {dut.node_id} on {opened.description}: two answers to one SDO request: another "
            "node has this node-ID, too, or it answers twice; nothing more was judged",
            file=sys.stderr,
        )
        return ExitCode.CHECK_FAILED
    return ExitCode.DONE


def _description(dut: DeviceUnderTest) -> str:
    """Describe the device under test: node, name of its EDS, and its own identity."""
    words = [f"Node {dut.node_id}", Path(dut.objects.source).name]
    for subindex, what in enumerate(("vendor", "product", "revision", "serial number"), start=1):
        try:
            words.append(f"{what} {dut.number(0x1018, subindex):08X}h")
        except Deviation:
            continue  # only the vendor must be there, and the report says where it is not
    return ", ".join(words)


def _print(results: list[Result], args: argparse.Namespace) -> None:
    if args.json:
        print(json_text(report.as_json(results)))
        return
    if args.quiet:
        for result in report.failures(results):
            print(report.line(result))
    for line in report.not_run(results):
        print(line)
    if not args.quiet:
        print(report.summary(results), file=sys.stderr)


def _write_report(
    results: list[Result], args: argparse.Namespace, device: str, allowed: Impact, eds: Path
) -> None:
    text = report.markdown(
        results, device=device, allowed=allowed, eds=check_eds(eds), command=_command(args)
    )
    with about_file(f"--report {args.report}"), whole_file(args.report) as file:
        file.write_text(text, encoding="utf-8", errors="backslashreplace")


def _command(args: argparse.Namespace) -> str | None:
    """Return the command that repeats the report; None if the bench is not reproducible."""
    if not args.virtual or args.config or args.eds:
        return None
    flags = [f"--{name}" for name in ("write", "store") if getattr(args, name)]
    words = ["hil-bench conformance --virtual --node-id", str(args.node_id), *flags]
    return " ".join([*words, "--report", args.report.as_posix()])
