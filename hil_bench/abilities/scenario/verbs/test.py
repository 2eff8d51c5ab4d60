"""`hil-bench test`: scenarios played on the virtual bench, and judged."""

import argparse
import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from hil_bench.abilities.common.arguments import count
from hil_bench.abilities.common.files import check_place
from hil_bench.abilities.common.progress import Work, shown_work
from hil_bench.abilities.common.shown_units import add_units_argument
from hil_bench.abilities.common.work import add_work_arguments, watched_work
from hil_bench.abilities.controllers.kinds import CONTROLLERS
from hil_bench.abilities.controllers.section import ControllersConfig
from hil_bench.abilities.eyes.frame_text import FrameText
from hil_bench.abilities.scenario.pool import Pool, TaskEnd
from hil_bench.abilities.scenario.report import Chapter
from hil_bench.abilities.scenario.resolve import PreparedScenario
from hil_bench.abilities.scenario.results import (
    ScenarioResult,
    blank_result,
    play_for_result,
    write_junit,
)
from hil_bench.abilities.scenario.run import PlayOptions, prepare
from hil_bench.abilities.scenario.verbs import scenario_report
from hil_bench.abilities.scenario.verbs.machine_test import (
    add_machine_arguments,
    is_on_machine,
    play_on_machine,
    prepare_chosen,
)
from hil_bench.abilities.scenario.verbs.scenario_arguments import (
    add_parameter_argument,
    read_parameter,
)
from hil_bench.abilities.scenario.verbs.scenario_view import show_results
from hil_bench.cli.exit_codes import Ending, interrupted_once
from hil_bench.cli.results import add_json_argument, print_lines, print_results
from hil_bench.errors import ConfigError

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
        "--jobs",
        type=count,
        default=1,
        metavar="N",
        help="play N scenarios side by side, in processes of their own (default: 1)",
    )
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
    scenario_report.add_report_argument(parser)
    add_json_argument(parser)
    add_units_argument(parser)
    add_machine_arguments(parser)
    add_work_arguments(parser, "test")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Play each scenario and print what was found."""
    _check_outputs(args)
    ending = Ending(args)
    given = dict(read_parameter(text) for text in args.given)
    paths = _find_all(args.paths)
    chapters: list[Chapter] = []
    if is_on_machine(args):
        results = play_on_machine(args, paths, given, ending)
        lines = [*scenario_report.result_lines(results)]
    else:
        results, chapters = _test_virtually(args, paths, given, ending)
        lines = []  # each was printed when it was known
    ending.take(scenario_report.exit_code_of_results(results))
    with ending.going_on():
        print_results(
            args, lines, {result.path: scenario_report.result_content(result) for result in results}
        )
    if args.junit:
        with ending.going_on():
            write_junit(results, args.junit)
    if chapters:
        with ending.going_on():
            scenario_report.write_report(args, "Test report", chapters)
    return ending.code


def _check_outputs(args: argparse.Namespace) -> None:
    """Refuse, before anything runs, what could not be written or done.

    Raises:
        ConfigError: a folder or a library is missing, or options do not go together.
    """
    scenario_report.check_report_argument(args)
    if args.junit is not None:
        check_place("--junit", args.junit)
    if args.jobs > 1 and is_on_machine(args):
        raise ConfigError(
            f"--jobs {args.jobs}: a machine plays one scenario at a time; leave it out"
        )


class Task(NamedTuple):
    """A scenario to be played, as it is passed to another process.

    Attributes:
        number: among those of the command line.
        path: its file.
        args: the command line.
        timeout: longest time that it may take [s].
    """

    number: int
    path: Path
    args: argparse.Namespace
    timeout: float = math.inf


class Played(NamedTuple):
    """A scenario that was played.

    Attributes:
        number: among those of the command line.
        result: without its evidence, which is large.
        chapter: of a report; None where none is asked for.
        messages: logger, level and text of what another process has logged meanwhile.
    """

    number: int
    result: ScenarioResult
    chapter: Chapter | None = None
    messages: tuple[tuple[str, int, str], ...] = ()


def _test_virtually(
    args: argparse.Namespace, paths: Sequence[Path], given: dict[str, float], ending: Ending
) -> tuple[list[ScenarioResult], list[Chapter]]:
    """Play scenarios on the virtual bench, and print what came of each as soon as it is known.

    Returns:
        The results, up to the one that was interrupted, and the chapters of a report, if one is
        asked for.
    """
    chosen = prepare_chosen(args, paths, lambda each: prepare(each, given, seed=args.seed))
    results: list[ScenarioResult] = []
    chapters: list[Chapter] = []
    work = Work("test", len(chosen), "scenarios")
    work.stage = str(chosen[0].scenario.path)
    with (
        interrupted_once(),
        watched_work(args, "test", ", ".join(map(str, args.paths))) as view,
        shown_work(args, work, pauses=not args.json),
    ):
        show_results(view, results, len(chosen), work.stage)
        is_apart = args.jobs > 1 or any(map(_may_end_its_process, chosen))
        for played in (_side_by_side if is_apart else _one_by_one)(args, chosen):
            for name, level, text in played.messages:
                logging.getLogger(name).log(level, "%s", text)
            results.append(played.result)
            if played.chapter is not None:
                chapters.append(played.chapter)
            if not args.json:
                with ending.going_on():
                    print_lines(args, *scenario_report.result_lines([played.result]))
            following = (str(each.scenario.path) for each in chosen[played.number + 1 :])
            work.done, work.stage = len(results), next(following, "")
            show_results(view, results, len(chosen), work.stage)
        show_results(view, results, len(chosen))
    return results, chapters


def _may_end_its_process(prepared: PreparedScenario) -> bool:
    """Return True if a controller's machine code runs with the bench, which its crash would end."""
    own, others = prepared.scenario.controller, prepared.config.of(ControllersConfig)
    kinds = [each.kind for each in others.controllers] if others else []
    given = own.table if own else {}
    named = CONTROLLERS.find(str(given["kind"])) if given else None
    return any(kind.is_native for kind in (*kinds, *([named] if named else ())))


def _one_by_one(args: argparse.Namespace, chosen: Sequence[PreparedScenario]) -> Iterator[Played]:
    for number, each in enumerate(chosen):
        try:
            played = _play(args, number, each)
        except KeyboardInterrupt:
            yield _ended(args, number, each, _interrupted(each))
            return
        yield played


def _side_by_side(args: argparse.Namespace, chosen: Sequence[PreparedScenario]) -> Iterator[Played]:
    """Yield what comes of scenarios in their order, each played by one of `--jobs` processes."""
    done: dict[int, Played] = {}
    due = 0

    def crashed(task: Task, _end: TaskEnd, problem: str) -> Played:
        each = chosen[task.number]
        return _ended(args, task.number, each, _blank(each, problem))

    tasks = (Task(number, each.scenario.path, args) for number, each in enumerate(chosen))
    with Pool(min(args.jobs, len(chosen)), play_task, crashed) as pool:
        try:
            for played in pool(tasks):
                done[played.number] = played
                while due in done:
                    yield done.pop(due)
                    due += 1
        except KeyboardInterrupt:
            each = chosen[due]
            yield _ended(args, due, each, _interrupted(each))
            yield from (done[number] for number in sorted(done))


def play_task(task: Task) -> Played:
    """Play a scenario in a process for it; what it logs is kept for the one who waits."""
    args = task.args
    given = dict(read_parameter(text) for text in args.given)
    (each,) = prepare_chosen(args, [task.path], lambda one: prepare(one, given, seed=args.seed))
    kept = _KeptMessages()
    root = logging.getLogger()
    level = root.level
    root.addHandler(kept)
    root.setLevel(logging.DEBUG if args.verbose > 1 else logging.WARNING)
    try:
        return _play(args, task.number, each)._replace(messages=tuple(kept.messages))
    finally:
        root.setLevel(level)
        root.removeHandler(kept)


class _KeptMessages(logging.Handler):
    """Keeps messages."""

    def __init__(self) -> None:
        super().__init__()
        self.messages: list[tuple[str, int, str]] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.messages.append((record.name, record.levelno, record.getMessage()))


def _play(args: argparse.Namespace, number: int, prepared: PreparedScenario) -> Played:
    has_report = bool(args.report)
    reader = FrameText if has_report else None
    options = PlayOptions(args.stop_at_failure, keeps_evidence=has_report, reader=reader)
    return _ended(args, number, prepared, play_for_result(prepared, options))


def _ended(
    args: argparse.Namespace, number: int, prepared: PreparedScenario, result: ScenarioResult
) -> Played:
    chapter = scenario_report.run_chapter(prepared, result, args.given) if args.report else None
    return Played(number, replace(result, evidence=None), chapter)


def _interrupted(prepared: PreparedScenario) -> ScenarioResult:
    return replace(_blank(prepared, "interrupted"), is_interrupted=True)


def _blank(prepared: PreparedScenario, problem: str) -> ScenarioResult:
    return blank_result(prepared.scenario, prepared.config.seed, prepared.parameters, problem)


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
