"""`hil-bench judge`: requirements held against recordings."""

import argparse
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from hil_bench.abilities.common.arguments import add_column_arguments
from hil_bench.abilities.common.progress import Work, shown_work
from hil_bench.abilities.common.shown_units import add_units_argument
from hil_bench.abilities.recording.column_map import check_polarities, read_column_map, read_named
from hil_bench.abilities.recording.mdf_blocks import holds_faults, read_events
from hil_bench.abilities.recording.quantities import find_doubts
from hil_bench.abilities.recording.reading import is_csv_of_bench, read_recording
from hil_bench.abilities.scenario.examination import Coverage
from hil_bench.abilities.scenario.judgement import Judgement, RequirementOutcome
from hil_bench.abilities.scenario.load import load_requirements
from hil_bench.abilities.scenario.reach import names_in
from hil_bench.abilities.scenario.recorded import Judged, judge_with_trace
from hil_bench.abilities.scenario.records import RequirementsFile
from hil_bench.abilities.scenario.verbs import scenario_report as reports
from hil_bench.abilities.scenario.verbs.scenario_arguments import (
    add_parameter_argument,
    read_parameter,
)
from hil_bench.cli.exit_codes import Ending
from hil_bench.cli.results import add_json_argument, print_results, warn_of
from hil_bench.errors import ConfigError, HilBenchError
from hil_bench.outside.recording.channels import Recording

_EXAMPLES = """\
A requirements file is TOML with [[expect]] tables, or a whole scenario; docs/expectations.md has
the language. With duration_s in it, what a recording lacks of that time is unknown.

exit code 1 where a requirement failed; 6 where none did, but one could not be decided, or its
trigger never became true

examples:
  hil-bench judge requirements.toml run.mf4
  hil-bench judge sag.scenario.toml run1.csv run2.csv --json
  hil-bench judge requirements.toml scope.csv --map "CH1=P_A:bar" --map "s=time:ms"
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
    parser.add_argument(
        "--start",
        type=_seconds,
        metavar="S",
        help="time of the recordings at which the run begins, in s\n"
        "(default: 0 where the requirements have duration_s, else the first row)",
    )
    add_parameter_argument(parser)
    foreign = parser.add_argument_group("tables of other tools")
    add_column_arguments(foreign)
    foreign.add_argument(
        "--axis", metavar="NAME", help="axis whose quantities they are (default: axis1)"
    )
    reports.add_report_argument(parser)
    add_json_argument(parser)
    add_units_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Judge each recording and print what was found."""
    reports.check_report_argument(args)
    given = dict(read_parameter(text) for text in args.given)
    file = load_requirements(args.requirements)
    content: dict[str, list[dict[str, object]]] = {}
    judged: dict[Path, Judged] = {}
    chapters, ending, said = [], Ending(args), set[str]()
    work = Work("judge", len(args.recordings), "recordings")
    with shown_work(args, work):
        for path in args.recordings:
            work.begin(str(path))
            try:
                signals = _read_signals(args, path)
                events = read_events(path) if path.suffix.lower() == ".mf4" else []
                faults = [span.label for span in events]
                found = judge_with_trace(
                    file, signals, str(path), args.start, given=given, faults=faults
                )
            except HilBenchError as error:  # of this one, or of the requirements
                if str(error) not in said:
                    ending.take_error(error)
                said.add(str(error))
                about_it = args.requirements, path, str(error), _options(args)
                chapters.append(reports.unread_chapter(*about_it))
                content[str(path)] = _unread_content(file, str(error))
                continue
            judged[path] = found
            content[str(path)] = reports.finding_content(found.findings)
            ending.take(reports.exit_code_for(found.findings, file.unjudged))
            names = names_in(each.requirement.condition for each in found.findings)
            doubts = [*find_doubts(signals, names), *_unseen_faults(args, path, found)]
            warn_of([f"{path}: {doubt}" for doubt in doubts])
            if args.report:
                about = file, path, signals, found, doubts
                chapters.append(reports.recording_chapter(*about, _options(args)))
    if judged:
        with ending.going_on():
            print_results(args, _lines(judged, file.unjudged), content)
    if args.report:
        with ending.going_on():
            reports.write_report(args, f"Judgement by {args.requirements}", chapters)
    return ending.code


def _unread_content(file: RequirementsFile, problem: str) -> list[dict[str, object]]:
    """Return, for a program, that a recording could not be judged: nothing of it is decided."""
    length = file.duration or 0.0
    coverage = Coverage(0.0, length, 0.0, length, file.duration is not None)
    judgement = Judgement(RequirementOutcome.INCONCLUSIVE, None, coverage, reason=problem)
    return [
        {"id": each.id, "that": each.that, "judgement": judgement, "text": problem}
        for each in file.expectations
    ]


def _unseen_faults(args: argparse.Namespace, path: Path, found: Judged) -> list[str]:
    """Return, beside a pass by a file of ours without events, that it says nothing of faults."""
    has_passed = RequirementOutcome.PASSED in (each.judgement.outcome for each in found.findings)
    if not has_passed or args.columns or args.map:
        return []
    unknown = "whether one changed nothing is not known"
    what = ""
    faults: bool | None = True
    if path.suffix.lower() == ".mf4":
        what, faults = "a recording of a bus", holds_faults(path)
    elif path.suffix.lower() == ".csv" and is_csv_of_bench(path):
        what, faults = "a CSV file", None
    if faults is None:
        seen = f"{what} does not hold the faults of its run"
        return [f"{seen}: {unknown}; the .mf4 file of the run says it"]
    if faults:
        return []
    return [f"it does not say that its recording ended, so it may lack faults: {unknown}"]


def _options(args: argparse.Namespace) -> list[str]:
    """Return the options that a verdict depends on, as the command line has them."""
    words = [word for text in args.given for word in ("--set", text)]
    words += [word for text in args.map for word in ("--map", text)]
    for option, value in (
        ("--start", args.start),
        ("--columns", args.columns),
        ("--axis", args.axis),
    ):
        words += [] if value is None else [option, str(value)]
    return words


def _read_signals(args: argparse.Namespace, path: Path) -> Recording:
    """Return a recording, with the names that a column map gives it.

    Raises:
        ConfigError: there is an axis and no map.
    """
    if not args.columns and not args.map:
        if args.axis:
            raise ConfigError("--axis is for --columns and --map; give one of them, too")
        return read_recording(path)
    mapped = read_column_map(args.columns, args.map).of(path.name)
    check_polarities(path, mapped)
    return read_named(path, mapped, args.axis or "axis1")


def _seconds(text: str) -> float:
    """Return a time.

    Raises:
        argparse.ArgumentTypeError: the text is no finite number.
    """
    try:
        time = float(text)
    except ValueError:
        time = math.nan
    if not math.isfinite(time):
        raise argparse.ArgumentTypeError(f"{text}: give a time in s, such as 12.5")
    return time


def _lines(judged: dict[Path, Judged], unjudged: Sequence[str]) -> Iterator[str]:
    for path, (findings, trace) in judged.items():
        yield f"{path}:"
        if trace.note:
            yield f"  {trace.note}"
        yield from reports.finding_lines(findings, unjudged)
