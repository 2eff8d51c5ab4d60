"""`hil-bench scenario`: check scenario files, list what they hold, convert them."""

import argparse
import json
from pathlib import Path

from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.records import Scenario
from hil_bench.abilities.scenario.run import prepare
from hil_bench.abilities.scenario.schema import scenario_schema
from hil_bench.abilities.scenario.writing import write_scenario
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.results import add_json_argument, print_results, warn_of
from hil_bench.errors import ConfigError

_EXAMPLES = """\
examples:
  hil-bench scenario check sag.scenario.toml
  hil-bench scenario list tests/*.scenario.toml
  hil-bench scenario convert sag.scenario.toml sag.csv
  hil-bench scenario schema > scenario.schema.json
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "scenario",
        description="Check scenario files, list their content, and convert TOML to CSV and back.",
        epilog=_EXAMPLES,
    )
    actions = parser.add_subparsers(title="actions", metavar="ACTION", required=True)
    check = actions.add_parser("check", help="check files against their benches")
    check.add_argument("files", nargs="+", type=Path, metavar="FILE")
    add_json_argument(check)
    check.set_defaults(run=run_check)
    listing = actions.add_parser("list", help="print title, steps and requirements")
    listing.add_argument("files", nargs="+", type=Path, metavar="FILE")
    add_json_argument(listing)
    listing.set_defaults(run=run_list)
    convert = actions.add_parser(
        "convert", help="convert a file; the suffix of the new file gives its format"
    )
    convert.add_argument("source", type=Path, metavar="FILE", help=".toml or .csv")
    convert.add_argument(
        "target", type=Path, metavar="NEW", help="new file, .toml or .csv; must not exist"
    )
    convert.set_defaults(run=run_convert)
    schema = actions.add_parser("schema", help="print a JSON schema, for editors")
    schema.set_defaults(run=run_schema)


def run_check(args: argparse.Namespace) -> int:
    """Check all files; what is wrong in any of them is told at once.

    Raises:
        ConfigError: something is wrong.
    """
    lines, wrong, doubts = [], [], []
    for path in args.files:
        try:
            scenario = load_scenario(path)
            doubts += prepare(scenario).doubts
        except ConfigError as error:
            wrong.append(str(error))
        else:
            lines.append(f"{path}: ok; {_summary(scenario)}")
    if wrong:
        raise ConfigError("\n".join(wrong))
    warn_of(doubts)
    print_results(args, lines, {"checked": args.files})
    return ExitCode.DONE


def run_list(args: argparse.Namespace) -> int:
    """Print what files hold."""
    found = {str(path): load_scenario(path) for path in args.files}
    lines = []
    for path, scenario in found.items():
        lines.append(f"{path}: {scenario.title}; {_summary(scenario)}")
        lines += [f"  {each.id}  {each.that}" for each in scenario.expectations]
    content = {
        path: {
            "title": scenario.title,
            "duration_s": scenario.duration,
            "requirement_ids": scenario.requirement_ids,
            "expectations": {each.id: each.that for each in scenario.expectations},
        }
        for path, scenario in found.items()
    }
    print_results(args, lines, content)
    return ExitCode.DONE


def run_convert(args: argparse.Namespace) -> int:
    """Write a scenario to a new file.

    Raises:
        ConfigError: the file is there already.
    """
    if args.target.exists():
        raise ConfigError(f"{args.target}: is there already; give the name of a new file")
    write_scenario(load_scenario(args.source), args.target)
    return ExitCode.DONE


def run_schema(_args: argparse.Namespace) -> int:
    """Print the schema of scenario files."""
    print(json.dumps(scenario_schema(), indent=2))
    return ExitCode.DONE


def _summary(scenario: Scenario) -> str:
    counts = (
        f"{scenario.duration:g} s",
        _number(len(scenario.steps), "step"),
        _number(len(scenario.expectations), "requirement"),
    )
    return ", ".join(counts)


def _number(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"
