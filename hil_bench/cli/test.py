"""`hil-bench test`: scenarios played on the virtual bench, and judged."""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from hil_bench.cli.exit_codes import ExitCode
from hil_bench.cli.interruption import interrupted_once
from hil_bench.cli.machine_side import add_machine_arguments, is_on_machine
from hil_bench.cli.machine_test import play_on_machine
from hil_bench.cli.results import add_json_argument, print_lines, print_results
from hil_bench.cli.scenario_arguments import add_parameter_argument, read_parameter
from hil_bench.cli.scenario_report import (
    add_report_argument,
    check_report_argument,
    run_chapter,
    write_report,
)
from hil_bench.cli.scenario_view import show_results
from hil_bench.cli.selection import prepare_chosen
from hil_bench.cli.verdicts import (
    exit_code_for,
    result_content,
    result_lines,
)
from hil_bench.cli.work_side import add_work_arguments, watched_work
from hil_bench.errors import ConfigError
from hil_bench.machine.frame_text import FrameText
from hil_bench.scenario.prepared import PreparedScenario
from hil_bench.scenario.report.content import Chapter
from hil_bench.scenario.results import (
    ScenarioResult,
    play_for_result,
    write_junit,
)
from hil_bench.scenario.run import PlayOptions, prepare

_SUFFIX = ".scenario.toml"  # of what is looked for in folders

_EXAMPLES = """\
exit code 1 where a requirement failed, or the firmware did; 6 where none did, but one could not be
decided, or its trigger never became true

examples:
  hil-bench test examples/scenarios
  hil-bench test examples/scenarios/supply_sag.scenario.toml --set position_gain=0.5
  hil-bench test examples/scenarios -k SRS-42 --stop-at-failure --junit result.xml --json
  hil-bench test examples/scenarios --report report.html
  hil-bench test steps.scenario.toml -i socketcan -c can0 --plan plan.toml
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "test",
        description="Play scenarios on the virtual bench, or with -i and -c on a machine, and\n"
        "judge their requirements: verdict, margin, and the comparison that decides.",
        epilog=_EXAMPLES,
    )
    parser.add_argument(
        "paths", nargs="+", type=Path, metavar="PATH", help=f"scenario, or folder with *{_SUFFIX}"
    )
    parser.add_argument(
        "-k",
        metavar="TEXT",
        default="",
        help="play only requirements with TEXT in file, title or id",
    )
    add_parameter_argument(parser)
    parser.add_argument(
        "--seed",
        type=int,
        metavar="N",
        help="seed of all random generators (default: that of the bench)",
    )
    parser.add_argument(
        "--stop-at-failure", action="store_true", help="end a run when a requirement has failed"
    )
    parser.add_argument(
        "--junit", type=Path, metavar="FILE", help="also write the verdicts as a JUnit file"
    )
    add_report_argument(parser)
    add_json_argument(parser)
    add_machine_arguments(parser)
    add_work_arguments(parser, "test")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Play each scenario and print what was found."""
    check_report_argument(args)
    given = dict(read_parameter(text) for text in args.given)
    paths = _find_all(args.paths)
    chapters: list[Chapter] = []
    if is_on_machine(args):
        results = play_on_machine(args, paths, given)
        lines = [*result_lines(results)]
    else:
        results, chapters = _test_virtually(args, paths, given)
        lines = []  # each was told when it was known
    print_results(args, lines, {result.path: result_content(result) for result in results})
    if args.junit:
        write_junit(results, args.junit)
    if chapters:
        write_report(args, "Test report", chapters)
    if any(result.is_interrupted for result in results):
        return ExitCode.INTERRUPTED
    return exit_code_for(set().union(*(result.outcomes for result in results)))


def _test_virtually(
    args: argparse.Namespace, paths: Sequence[Path], given: dict[str, float]
) -> tuple[list[ScenarioResult], list[Chapter]]:
    """Play scenarios on the virtual bench, and print what came of each as soon as it is known.

    Returns:
        The results, up to the one that was interrupted, and the chapters of a report, if one is
        asked for.
    """
    chosen = prepare_chosen(args, paths, lambda each: prepare(each, given, seed=args.seed))
    reader = FrameText if args.report else None
    options = PlayOptions(args.stop_at_failure, keeps_evidence=bool(args.report), reader=reader)
    results: list[ScenarioResult] = []
    chapters: list[Chapter] = []
    with interrupted_once(), watched_work(args, "test", ", ".join(map(str, args.paths))) as view:
        for each in chosen:
            show_results(view, results, len(chosen), str(each.scenario.path))
            try:
                result = play_for_result(each, options)
            except KeyboardInterrupt:
                result = _interrupted(each)
            if args.report:
                chapters.append(run_chapter(each, result, args.given))
            results.append(replace(result, evidence=None))  # it is large
            if not args.json:
                print_lines(args, *result_lines([result]))
            if result.is_interrupted:
                break
        show_results(view, results, len(chosen))
    return results, chapters


def _interrupted(prepared: PreparedScenario) -> ScenarioResult:
    scenario, parameters = prepared.scenario, dict(prepared.parameters)
    about = str(scenario.path), scenario.title, scenario.requirement_ids, prepared.config.seed
    return ScenarioResult(*about, parameters, problem="interrupted", is_interrupted=True)


def _find_all(paths: Sequence[Path]) -> list[Path]:
    """Return the files of the scenarios.

    Raises:
        ConfigError: a folder has none.
    """
    found: list[Path] = []
    for path in paths:
        inside = sorted(path.rglob(f"*{_SUFFIX}")) if path.is_dir() else [path]
        if not inside:
            raise ConfigError(f"{path}: holds no *{_SUFFIX}; give a folder that does, or a file")
        found += inside
    return list(dict.fromkeys(found))
