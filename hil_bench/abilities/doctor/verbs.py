"""`hil-bench doctor`: what this machine can do for a bench, and what to change."""

import argparse
import json
import os
import platform
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict

from hil_bench import __version__
from hil_bench.abilities.doctor.machine import (
    LatenessTest,
    Topic,
    Verdict,
    examine_machine,
    examine_permissions,
    measure_lateness,
    read_file,
)
from hil_bench.abilities.doctor.software import examine_buses, examine_extensions, examine_software
from hil_bench.bench.configuration import RealtimePolicy, load_config
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.results import add_json_argument
from hil_bench.errors import ConfigError
from hil_bench.outside.realtime.clock import MonotonicClock

_LONGEST = 3600.0
_MARKS = {Verdict.GOOD: "ok", Verdict.HINT: "hint", Verdict.MISSING: "no", Verdict.ABSENT: "-"}
_COLOURS = {"ok": "\x1b[32m", "hint": "\x1b[33m", "no": "\x1b[31m", "-": "\x1b[2m"}
_RESET, _BOLD = "\x1b[0m", "\x1b[1m"
_POLICIES = {"SCHED_FIFO": RealtimePolicy.FIFO, "SCHED_DEADLINE": RealtimePolicy.DEADLINE}

_EXAMPLES = """\
examples:
  hil-bench doctor
  hil-bench doctor --seconds 60        a longer test of the lateness
  hil-bench doctor --json
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "doctor",
        description="Show what this machine can do for a bench in real time: permissions, kernel,\n"
        "processors, CAN, software, installed kinds of devices and plants, the lateness of a\n"
        "short run; and what to change. Nothing is changed.",
        epilog=_EXAMPLES,
    )
    add_json_argument(parser)
    parser.add_argument(
        "--seconds",
        type=float,
        default=2.0,
        metavar="S",
        help="measure the lateness for S seconds (default: 2); 0 for not at all",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Look at everything, measure, print it.

    Raises:
        ConfigError: the length of the test makes no sense.
    """
    if not 0 <= args.seconds <= _LONGEST:
        raise ConfigError(f"--seconds {args.seconds:g}: give 0 to {_LONGEST:g} s")
    permissions, machine = examine_permissions(read_file), examine_machine(read_file)
    buses = examine_buses(read_file)
    tests = measure(args.seconds, permissions)
    topics = (permissions, machine, buses, examine_software(), examine_extensions())
    if args.json:
        print(json.dumps(found_content(topics, tests), indent=2))
    elif not args.quiet:
        is_coloured = sys.stdout.isatty() and not os.environ.get("NO_COLOR")
        print(*report_lines(topics, tests, is_coloured=is_coloured), sep="\n", flush=True)
    return ExitCode.DONE


def measure(seconds: float, permissions: Topic) -> list[LatenessTest]:
    """Return the lateness without a policy and with those that are permitted."""
    permitted = {item.name for item in permissions.findings if item.verdict is Verdict.GOOD}
    policies = [policy for name, policy in _POLICIES.items() if name in permitted]
    config = load_config()
    if not seconds:
        return []
    return measure_lateness(config, seconds, [RealtimePolicy.OFF, *policies], MonotonicClock())


def found_content(topics: Sequence[Topic], tests: Sequence[LatenessTest]) -> dict[str, object]:
    """Return all of it for a program."""
    return {
        "version": __version__,
        "system": platform.platform(),
        "findings": [
            {"topic": topic.name, **asdict(finding)}
            for topic in topics
            for finding in topic.findings
        ],
        "lateness": [{"name": test.name, **asdict(test.summary)} for test in tests],
    }


def report_lines(
    topics: Sequence[Topic], tests: Sequence[LatenessTest], *, is_coloured: bool
) -> Iterator[str]:
    """Yield the report for people.

    Yields:
        Its lines.
    """

    def paint(text: str, colour: str) -> str:
        return f"{colour}{text}{_RESET}" if is_coloured else text

    yield f"hil-bench {__version__} on {platform.platform()}"
    width = max(len(finding.name) for topic in topics for finding in topic.findings)
    for topic in topics:
        yield ""
        yield paint(topic.name, _BOLD)
        for finding in topic.findings:
            mark = _MARKS[finding.verdict]
            painted = paint(f"{mark:4}", _COLOURS[mark])
            yield f"  {painted}  {finding.name:{width}}  {finding.value}"
            if finding.advice:
                yield f"  {'':{width + 6}}  {paint('->', _COLOURS[mark])} {finding.advice}"
    if tests:
        yield ""
        yield paint(f"Lateness at 1 kHz, {tests[0].summary.ticks} ticks each [us]", _BOLD)
        yield from lateness_lines(tests)


def lateness_lines(tests: Iterable[LatenessTest]) -> Iterator[str]:
    """Yield the table of the measured lateness.

    Yields:
        Its lines.
    """
    yield f"  {'':24}{'p50':>8}{'p99':>8}{'p99.9':>8}{'max':>8}{'overruns':>10}"
    for test in tests:
        late = test.summary.lateness
        figures = (late.p50_us, late.p99_us, late.p999_us, late.max_us)
        columns = "".join(f"{figure:8.0f}" for figure in figures)
        yield f"  {test.name:24}{columns}{test.summary.overruns:10}"
