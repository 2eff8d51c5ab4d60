"""`hil-bench check-eds`: what is wrong in EDS files, with line numbers."""

import argparse
import json
from pathlib import Path

from hil_bench.cli.exit_codes import ExitCode
from hil_bench.eds_check import check_eds

_EXAMPLES = """\
examples:
  hil-bench check-eds vendor.eds
  hil-bench check-eds *.eds --json

exit code 1 where a file has findings
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "check-eds",
        description="Check EDS files (CiA 306) beyond what loaders notice: lists and counts, "
        "formats,\ndata types, limits and defaults, PDO mappings with their targets and lengths.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="an EDS file")
    parser.add_argument("--json", action="store_true", help="print JSON for a program to read")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Check all files and print what was found."""
    found = {str(path): check_eds(path) for path in args.files}
    if args.json:
        print(json.dumps({path: [f._asdict() for f in some] for path, some in found.items()}))
    else:
        for path, findings in found.items():
            print(
                "\n".join(f"{path}:{f.line}: [{f.section}] {f.text}" for f in findings)
                or f"{path}: ok"
            )
    return ExitCode.CHECK_FAILED if any(found.values()) else ExitCode.DONE
