"""`hil-bench falsify`: a search for what makes a requirement fail."""

import argparse
import logging
import shlex
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path

from hil_bench.abilities.campaign.falsify import Failure, Falsification, SearchPlan, falsify
from hil_bench.abilities.campaign.records import RunResult
from hil_bench.abilities.campaign.reports import write_search_report
from hil_bench.abilities.campaign.search import ALL_METHODS, Budget, Find, Method, SearchResult
from hil_bench.abilities.campaign.snapshot import local_backend
from hil_bench.abilities.campaign.store import set_words
from hil_bench.abilities.campaign.verbs.campaign_view import (
    CampaignView,
    add_jobs_argument,
    count_runs,
)
from hil_bench.abilities.common.arguments import count, count_from_zero, positive
from hil_bench.abilities.common.progress import (
    Work,
    shown_work,
)
from hil_bench.abilities.common.shown_units import add_units_argument
from hil_bench.abilities.common.work import add_work_arguments, watched_work
from hil_bench.abilities.scenario.verbs.scenario_arguments import (
    add_parameter_argument,
    read_parameter,
)
from hil_bench.abilities.scenario.verbs.scenario_report import check_report_argument
from hil_bench.cli.exit_codes import Ending, ExitCode, interrupted_once, verdict_code
from hil_bench.cli.results import add_json_argument, print_results
from hil_bench.errors import require_extra

logger = logging.getLogger(__name__)

_EXAMPLES = """\
The space is that of the scenario's parameters with a range. Each method gets the same number of
runs. A failure is shrunk, and written as a scenario and as a pytest file. After Ctrl-C the same
command goes on where it was ended.

exit code 1 where a requirement failed or a run crashed; 6 where none did, but a requirement was
never decided

examples:
  hil-bench falsify sag.scenario.toml
  hil-bench falsify sag.scenario.toml --method cma-es --runs 1000 --output failures
  hil-bench falsify sag.scenario.toml --minutes 10 --jobs 2 --report report.html
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "falsify",
        description="Search for values of a scenario's parameters at which a requirement fails.",
        epilog=_EXAMPLES,
    )
    parser.add_argument(
        "scenario", type=Path, metavar="SCENARIO", help="scenario whose parameters have ranges"
    )
    parser.add_argument(
        "--runs",
        type=count,
        default=200,
        metavar="N",
        help="runs of each method (default: %(default)s)",
    )
    parser.add_argument(
        "--minutes",
        type=positive,
        metavar="M",
        help="time limit of all methods together, in minutes",
    )
    parser.add_argument(
        "--method",
        action="append",
        type=Method,
        choices=list(ALL_METHODS),
        dest="methods",
        help="method of the search; repeat it for more (default: all)",
    )
    parser.add_argument(
        "--seed",
        type=count_from_zero,
        default=0,
        metavar="N",
        help="seed of the search (default: 0)",
    )
    parser.add_argument(
        "--timeout-s",
        type=positive,
        default=60.0,
        metavar="S",
        help="time-out of a run in s (default: 60)",
    )
    parser.add_argument(
        "--stop-at-failure", action="store_true", help="end when all requirements have failed"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("failures"),
        metavar="DIR",
        help="folder for the failures (default: %(default)s)",
    )
    parser.add_argument(
        "--report", type=Path, metavar="FILE", help="write an HTML report that opens offline"
    )
    add_parameter_argument(parser)
    add_jobs_argument(parser)
    add_json_argument(parser)
    add_units_argument(parser)
    add_work_arguments(parser, "falsify")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Search, and print what was found."""
    for package in ("cmaes", "pyarrow", "scipy"):
        require_extra(package, "hil-bench falsify", "campaign")
    check_report_argument(args)
    plan = SearchPlan(
        tuple(args.methods or ALL_METHODS),
        Budget(args.runs, args.minutes),
        args.seed,
        args.timeout_s,
        args.stop_at_failure,
        dict(map(read_parameter, args.given)),
    )
    with ExitStack() as stack:
        stack.enter_context(interrupted_once())
        backend = stack.enter_context(local_backend(args.jobs))
        total = args.runs * len(plan.methods)
        note = count_runs(stack.enter_context(shown_work(args, Work("falsify", total, "runs"))))
        shown = stack.enter_context(watched_work(args, "falsify", str(args.scenario)))
        view = CampaignView(shown, total, _command(args), is_search=True)
        stack.callback(view.show)

        def tell(result: RunResult | None) -> None:
            note(result)
            view.note(result)

        found = falsify(args.scenario, plan, backend, args.output, tell)
    if found.is_interrupted:
        done = f"interrupted after {len(found.search.trials)} of {total} runs"
        further = found.problem or "the same command goes on from there"
        logger.warning("%s: %s; %s", args.scenario, done, further)
    ending = Ending(args)
    ending.take(exit_code_of_search(found.search))
    if found.is_interrupted:
        ending.take(ExitCode.INTERRUPTED)
    with ending.going_on():
        print_results(args, found.lines(), _content(found))
    if args.report:
        with ending.going_on():
            write_search_report(args.report, found)
    return ending.code


def _command(args: argparse.Namespace) -> Callable[[RunResult], str]:
    """Return a function that returns what repeats a run of the search in a shell."""
    given = dict(map(read_parameter, args.given))

    def command(result: RunResult) -> str:
        words = ["hil-bench", "test", str(args.scenario), *set_words({**given, **result.values})]
        return shlex.join(words)

    return command


def exit_code_of_search(search: SearchResult) -> ExitCode:
    """Return the exit code for what a search found; one without a requirement decides nothing."""
    finds = search.finds
    return verdict_code(
        fails=bool(search.crashes) or any(each.is_failed for each in finds),
        passes=bool(finds)
        and all(each.tally.passed and not each.tally.undecided for each in finds),
    )


def _content(found: Falsification) -> dict[str, object]:
    return {
        "set": found.plan.given,
        "runs": {method.value: len(found.search.of(method)) for method in found.plan.methods},
        "requirements": [_find(each) for each in found.search.finds],
        "failures": [_failure(each) for each in found.failures],
        "is_interrupted": found.is_interrupted,
    }


def _find(find: Find) -> dict[str, object]:
    return {
        "id": find.id,
        "is_failed": find.is_failed,
        "is_exercised": find.tally.decided > 0,
        "undecided_runs": find.tally.undecided,
        "first_failure": {method.value: number for method, number in find.first.items()},
        "smallest_margin": find.margin,
        "at": find.worst.point if find.worst else None,
    }


def _failure(failure: Failure) -> dict[str, object]:
    return {
        "requirement": failure.target.requirement or None,
        "files": list(failure.files or ()),
        "shrunk": asdict(failure.shrunk.scenario) if failure.shrunk else None,
    }
