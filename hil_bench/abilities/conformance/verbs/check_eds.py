"""`hil-bench check-eds`: what is wrong in EDS files, with line numbers."""

import argparse
import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from hil_bench.abilities.conformance.eds_check import check_eds
from hil_bench.canopen_device.eds_document import EdsFinding, Severity
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.results import add_json_argument, print_lines

_EXAMPLES = """\
examples:
  hil-bench check-eds vendor.eds
  hil-bench check-eds *.eds --strict
  hil-bench check-eds *.eds --json

An error does not work: a value beyond its limit, a PDO of wrong length, an object that is missing.
A warning deviates from CiA 306, and works.

exit code 1 where a file has errors, with --strict also where it has warnings
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "check-eds",
        description="Check EDS files (CiA 306) more strictly than loaders do: lists and counts, "
        "formats,\ndata types, limits and defaults, PDO mappings with their targets and lengths.",
        epilog=_EXAMPLES,
    )
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="EDS file")
    parser.add_argument("--strict", action="store_true", help="count warnings as errors")
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Check all files and print what was found."""
    found = {str(path): check_eds(path) for path in args.files}
    if args.json:
        print(json.dumps({path: [f._asdict() for f in some] for path, some in found.items()}))
    else:
        for path, findings in found.items():
            print_lines(args, *(f"{path}:{f}" for f in findings), f"{path}: {_summary(findings)}")
    fails = any(
        args.strict or finding.severity is Severity.ERROR
        for findings in found.values()
        for finding in findings
    )
    return ExitCode.CHECK_FAILED if fails else ExitCode.DONE


def _summary(findings: Sequence[EdsFinding]) -> str:
    if not findings:
        return "ok"
    counts = Counter(finding.severity for finding in findings)
    errors, warnings = counts[Severity.ERROR], counts[Severity.WARNING]
    will_not_work = ", which will not work" if errors else ""
    return f"{_number(errors, 'error')}{will_not_work}; {_number(warnings, 'warning')}"


def _number(count: int, what: str) -> str:
    return f"{count or 'no'} {what}{'' if count == 1 else 's'}"
