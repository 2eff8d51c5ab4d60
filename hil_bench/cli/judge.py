"""`hil-bench judge`: requirements held against recordings."""

import argparse
from collections.abc import Iterator
from pathlib import Path

from hil_bench.cli.exit_codes import Ending
from hil_bench.cli.results import add_json_argument, print_results
from hil_bench.cli.scenario_report import (
    add_report_argument,
    check_report_argument,
    recording_chapter,
    write_report,
)
from hil_bench.cli.verdicts import exit_code_for, finding_content, finding_lines
from hil_bench.outside.recording.files import read_recording
from hil_bench.scenario.recorded import Finding, judge_with_trace

_EXAMPLES = """\
A requirements file is TOML with [[expect]] tables, or a whole scenario; docs/expectations.md has
the language.

exit code 1 where a requirement failed; 6 where none did, but one could not be decided, or its
trigger never became true

examples:
  hil-bench judge requirements.toml run.mf4
  hil-bench judge sag.scenario.toml run1.csv run2.csv --json
  hil-bench judge requirements.toml run.mf4 --report report.html
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "judge",
        description="Judge recordings of the bench or of a machine by requirements: verdict,\n"
        "margin, and the comparison that decides.",
        epilog=_EXAMPLES,
    )
    parser.add_argument(
        "requirements", type=Path, metavar="REQUIREMENTS", help="requirements, .toml or .csv"
    )
    parser.add_argument(
        "recordings", type=Path, nargs="+", metavar="RECORDING", help="recording, .mf4 or .csv"
    )
    add_report_argument(parser)
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Judge each recording and print what was found."""
    check_report_argument(args)
    judged = {}
    chapters = []
    for path in args.recordings:
        signals = read_recording(path)
        judged[path] = judge_with_trace(args.requirements, signals, str(path))
        if args.report:
            chapters.append(recording_chapter(args.requirements, path, signals, judged[path]))
    found = {path: each.findings for path, each in judged.items()}
    content = {str(path): finding_content(findings) for path, findings in found.items()}
    outcomes = (each.judgement.outcome for findings in found.values() for each in findings)
    ending = Ending(args)
    ending.take(exit_code_for(outcomes))
    with ending.going_on():
        print_results(args, _lines(found), content)
    if args.report:
        with ending.going_on():
            write_report(args, f"Judgement by {args.requirements}", chapters)
    return ending.code


def _lines(found: dict[Path, list[Finding]]) -> Iterator[str]:
    for path, findings in found.items():
        yield f"{path}:"
        yield from finding_lines(findings)
