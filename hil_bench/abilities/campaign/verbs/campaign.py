"""`hil-bench campaign`: thousands of runs of scenarios, kept, resumed, merged and compared."""

import argparse
import logging
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

from hil_bench.abilities.campaign.dask import DaskBackend
from hil_bench.abilities.campaign.distributions import Sampler
from hil_bench.abilities.campaign.plan import Plan
from hil_bench.abilities.campaign.records import RunOutcome, RunResult, read_campaign
from hil_bench.abilities.campaign.reports import replay, write_campaign_report
from hil_bench.abilities.campaign.sensitivity import Sensitivity, sobol_indices
from hil_bench.abilities.campaign.snapshot import local_backend, perform
from hil_bench.abilities.campaign.store import Store
from hil_bench.abilities.campaign.summary import (
    Change,
    bounds_of,
    command_of,
    compare,
    count_outcomes,
    show_point,
    summarise,
    unjudged_of,
    worst_runs,
)
from hil_bench.abilities.campaign.table import WHOLE, Outcome, Shard, collect, execute
from hil_bench.abilities.campaign.verbs.campaign_view import (
    CampaignView,
    add_jobs_argument,
    count_runs,
)
from hil_bench.abilities.common.arguments import count, count_from_zero
from hil_bench.abilities.common.files import whole_file
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
from hil_bench.cli.exit_codes import Ending, ExitCode, interrupted_once, verdict_code, worst
from hil_bench.cli.results import add_json_argument, print_results
from hil_bench.errors import (
    ConfigError,
    HilBenchError,
    about_file,
    require_extra,
)

logger = logging.getLogger(__name__)

_SHOWN = 3  # worst runs on the terminal

_EXAMPLES = """\
The same command resumes where it was ended. To merge the results of several machines, copy their
folders into one, and give that with --output and --merge.

exit code 1 where a run failed, crashed or timed out; 6 where none did, but a requirement could not
be decided or was never exercised, or runs are missing

examples:
  hil-bench campaign campaign.toml --jobs 2 --report report.html
  hil-bench campaign sag.scenario.toml --runs 256 --sampler monte_carlo
  hil-bench campaign campaign.toml --shard 3/16 --output shard3
  hil-bench campaign campaign.toml --output all --merge --compare before
  hil-bench campaign campaign.toml --run 5f2c9a01
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb."""
    parser = subparsers.add_parser(
        "campaign",
        description="Run scenarios thousands of times over parameters, benches and firmware, and\n"
        "print verdicts, smallest margins and a bound on the failure probability.",
        epilog=_EXAMPLES,
    )
    parser.add_argument(
        "campaign",
        type=Path,
        metavar="FILE",
        help="campaign.toml, or a scenario whose parameters have ranges",
    )
    parser.add_argument(
        "--runs", type=count, metavar="N", help="points of each scenario (default: 64)"
    )
    parser.add_argument(
        "--sampler",
        choices=[each.value for each in Sampler],
        metavar="NAME",
        help=f"how points are chosen: {', '.join(Sampler)} (default: sobol); monte_carlo allows a "
        "bound",
    )
    parser.add_argument(
        "--seed", type=count_from_zero, metavar="N", help="seed of the sampler (default: 0)"
    )
    add_parameter_argument(parser)
    add_jobs_argument(parser)
    parser.add_argument(
        "--shard", type=_shard, default=WHOLE, metavar="I/N", help="run part I of N, as in 3/16"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="DIR",
        help="folder of the results (default: the name of FILE with .results)",
    )
    parser.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="run on the Dask cluster of this scheduler, as in tcp://host:8786",
    )
    parser.add_argument("--merge", action="store_true", help="run nothing, show the results so far")
    parser.add_argument(
        "--run", metavar="KEY", dest="key", help="repeat one run, by the first digits of its key"
    )
    parser.add_argument(
        "--picture",
        type=Path,
        metavar="FILE.svg",
        help="with --run: draw its requirement with the smallest margin",
    )
    parser.add_argument(
        "--compare",
        type=Path,
        metavar="DIR",
        help="compare with these results, from before a change",
    )
    parser.add_argument(
        "--report", type=Path, metavar="FILE", help="write an HTML report that opens offline"
    )
    add_json_argument(parser)
    add_units_argument(parser)
    add_work_arguments(parser, "campaign")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Do the campaign, and print what came of it.

    Raises:
        ConfigError: an argument is wrong.
    """
    for package in ("pandas", "pyarrow", "scipy"):
        require_extra(package, "hil-bench campaign", "campaign")
    check_report_argument(args)
    if args.picture and not args.key:
        raise ConfigError("--picture: is of one run; give --run KEY with it")
    campaign = read_campaign(args.campaign)
    given = dict(map(read_parameter, args.given))
    changed = campaign.changed(runs=args.runs, sampler=args.sampler, seed=args.seed, given=given)
    plan = Plan(changed)
    if args.key:
        return _repeat(args, plan)
    if not args.output:
        args.output = args.campaign.with_name(f"{args.campaign.name.split('.')[0]}.results")
    if args.merge and not args.output.is_dir():
        raise ConfigError(f"--merge: there is no folder {args.output}; give that of the results")
    store = Store(args.output, plan.firmware, given)
    ending, seen = Ending(args), set[RunOutcome]()
    try:
        is_whole = args.merge or _execute(args, plan, store, seen)
    except HilBenchError as error:  # as of a full disk; a run may have failed before
        ending.take_error(error)
        ending.take(exit_code_of_runs(seen or {RunOutcome.PASSED}))
        return ending.code
    outcome = collect(plan, store, args.shard)
    changes = compare(_before(args.compare), outcome.results) if args.compare else []
    sensitivity = sobol_indices(plan, outcome.results)
    found = plan, outcome, changes, sensitivity
    lines = [*_lines(*found), f"  results are in {args.output}"]
    ending.take(_exit_code(plan, outcome))
    if not is_whole:
        ending.take(ExitCode.INTERRUPTED)
    with ending.going_on():
        print_results(args, lines, _content(*found))
    if args.report:
        with ending.going_on():
            write_campaign_report(args.report, *found)
    return ending.code


def exit_code_of_runs(outcomes: set[RunOutcome]) -> ExitCode:
    """Return the exit code for the outcomes of runs."""
    return verdict_code(
        fails=any(each.is_failure for each in outcomes), passes=outcomes == {RunOutcome.PASSED}
    )


def _execute(args: argparse.Namespace, plan: Plan, store: Store, seen: set[RunOutcome]) -> bool:
    """Do the runs that are not done yet; return False where somebody interrupts that.

    Args:
        args: the command line.
        plan: of the campaign.
        store: takes the results.
        seen: takes the outcomes of the runs that are done here, kept or not.
    """
    with ExitStack() as stack:
        stack.enter_context(interrupted_once())
        opened = DaskBackend(args.dask) if args.dask else local_backend(args.jobs)
        backend = stack.enter_context(opened)
        total = len(range(args.shard.number - 1, len(plan), args.shard.parts))
        note = count_runs(stack.enter_context(shown_work(args, Work("campaign", total, "runs"))))
        title = str(args.campaign)
        watched = watched_work(args, "campaign", title, again=_again(args))
        shown = stack.enter_context(watched)
        view = CampaignView(shown, total, lambda result: command_of(plan, result))
        stack.callback(view.show)

        def tell(result: RunResult | None) -> None:
            note(result)
            view.note(result)
            if result is not None:
                seen.add(result.outcome)

        try:
            execute(plan, store, backend, args.shard, tell)
        except KeyboardInterrupt:
            kept = "what is done is kept; the same command goes on from there"
            logger.warning("%s: interrupted; %s", store.folder, kept)
            return False
    return True


def _again(args: argparse.Namespace) -> list[str]:
    """Return the command that repeats runs of this campaign, without their key."""
    given = (f"--set={text}" for text in args.given)
    chosen = (
        f"--{name}={value}"
        for name in ("runs", "sampler", "seed")
        if (value := getattr(args, name)) is not None
    )
    return ["campaign", str(args.campaign.resolve()), *chosen, *given]


def _before(folder: Path) -> Iterator[RunResult]:
    """Return the results of an earlier campaign.

    Raises:
        ConfigError: there is no such folder.
    """
    if not folder.is_dir():
        raise ConfigError(f"--compare {folder}: is no folder; give one with results of a campaign")
    return Store(folder, {}).results(is_foreign=True)


def _repeat(args: argparse.Namespace, plan: Plan) -> int:
    """Do one run again, and print what came of it.

    Raises:
        ConfigError: no run, or more than one, has such a key.
    """
    found = [spec for spec in plan if spec.key.startswith(args.key)]
    if len(found) != 1:
        wrong = "begin several keys" if found else "begin no run's key"
        raise ConfigError(f"--run {args.key}: these digits {wrong}; the report shows them whole")
    result = perform(found[0])
    lines = [f"{result.scenario}: {show_point(result.values)}: {result.outcome}"]
    lines += [f"  {result.problem}"] if result.problem else []
    lines += [f"  {each.id}  {each.outcome:13}  {each.reason}" for each in result.verdicts]
    content: dict[str, object] = {"run": result}
    if args.picture:
        picture, problem = replay(found[0], result)
        if picture:
            with about_file(args.picture), whole_file(args.picture) as file:
                file.write_bytes(picture)
        lines.append(f"  {problem}" if problem else f"  drawn in {args.picture}")
        content["picture"] = problem or str(args.picture)
    print_results(args, lines, content)
    return exit_code_of_runs({result.outcome})


def _exit_code(plan: Plan, outcome: Outcome) -> ExitCode:
    code = exit_code_of_runs({each.outcome for each in outcome.results})
    is_open = outcome.missing or any(unjudged_of(plan))
    return worst(code, ExitCode.INCONCLUSIVE if is_open else ExitCode.DONE)


def _lines(
    plan: Plan, outcome: Outcome, changes: list[Change], sensitivity: Sensitivity
) -> Iterator[str]:
    counts = ", ".join(f"{n} {name}" for name, n in count_outcomes(outcome.results).items())
    missing = f"; {outcome.missing} not done yet" if outcome.missing else ""
    yield f"{len(outcome.results)} runs: {counts or 'none'}{missing}"
    for summary in summarise(outcome.results):
        yield f"  {summary.line()}"
    yield from (f"  {line}" for line in unjudged_of(plan))
    yield from (f"  {line}" for line in bounds_of(plan, outcome.results))
    yield from (f"  {line}" for line in sensitivity.lines())
    yield from (f"  {change.line()}" for change in changes)
    failed = [each for each in outcome.results if each.outcome.is_failure]
    for result in worst_runs(failed, _SHOWN):
        problem = f": {result.problem.splitlines()[0]}" if result.problem else ""
        yield f"  {result.outcome}{problem}; repeat it: {command_of(plan, result)}"
    yield f"  digest of the results {outcome.digest}"


def _content(
    plan: Plan, outcome: Outcome, changes: list[Change], sensitivity: Sensitivity
) -> dict[str, object]:
    return {
        "set": plan.campaign.given,
        "runs": len(outcome.results),
        "missing": outcome.missing,
        "digest": outcome.digest,
        "outcomes": count_outcomes(outcome.results),
        "requirements": [
            {
                "scenario": each.scenario,
                "id": each.id,
                "outcomes": each.outcomes,
                "smallest_margin": min(each.margins, default=None),
                "at": each.worst.values if each.worst else None,
                "least_seen": each.seen,
            }
            for each in summarise(outcome.results)
        ],
        "unjudged": list(unjudged_of(plan)),
        "bounds": list(bounds_of(plan, outcome.results)),
        "sobol_indices": [each.content() for each in sensitivity.indices],
        "worst": [
            {**each._asdict(), "command": command_of(plan, each)}
            for each in worst_runs(outcome.results)
        ],
        "changes": [
            each._replace(broken=len(each.broken), mended=len(each.mended))._asdict()  # type: ignore[arg-type]
            for each in changes
        ],
    }


def _shard(text: str) -> Shard:
    """Return the part that ``I/N`` names.

    Raises:
        argparse.ArgumentTypeError: it names none.
    """
    number, _, count = text.partition("/")
    if not (number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count)):
        raise argparse.ArgumentTypeError(f"{text}: give I/N, as in 3/16, I from 1 to N")
    return Shard(int(number), int(count))
