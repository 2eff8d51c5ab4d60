"""One run: a pure function of what its key is made of."""

from collections.abc import Callable
from pathlib import Path

from hil_bench.abilities.campaign.identity import case_digest, controller_digest
from hil_bench.abilities.campaign.plan import nested
from hil_bench.abilities.campaign.records import Case, RunOutcome, RunResult, RunSpec, Verdict
from hil_bench.abilities.scenario.judgement import WORST_FIRST
from hil_bench.abilities.scenario.recorded import Finding
from hil_bench.abilities.scenario.resolve import PreparedScenario
from hil_bench.abilities.scenario.results import reason_of
from hil_bench.abilities.scenario.run import PLAIN, PlayOptions, Run, play, prepare
from hil_bench.errors import ConfigError, HilBenchError

_LONGEST_PROBLEM = 2000  # characters that are kept of a firmware's last words
_CHECKED: set[tuple[Path, str]] = set()
"""The cases that this process has found as they are in the campaign: scenario and digest."""


def perform(spec: RunSpec) -> RunResult:
    """Perform a run and return its result; a controller that fails is a result too.

    A `ConfigError` says that the files here are not those of the campaign.
    """
    check_case(spec.case)
    return conclude(spec, lambda: play_spec(spec))


def conclude(spec: RunSpec, do: Callable[[], Run]) -> RunResult:
    """Do a run and return its result, also where it fails.

    Args:
        spec: the run.
        do: plays it.
    """
    try:
        run = do()
    except HilBenchError as error:
        return failed_run(spec, RunOutcome.CRASHED, str(error))
    except Exception as error:
        return failed_run(spec, RunOutcome.CRASHED, f"{type(error).__name__}: {error}")
    outcomes = {finding.judgement.outcome for finding in run.findings}
    worst = next(each for each in WORST_FIRST if each in outcomes)
    return failed_run(spec, RunOutcome(worst), run.ending)._replace(
        duration=run.duration, verdicts=verdicts_of(run)
    )


def play_spec(spec: RunSpec, options: PlayOptions = PLAIN) -> Run:
    """Play the scenario of a run; `HilBenchError` says what fails.

    Args:
        spec: the run.
        options: how to play.
    """
    return play(prepare_spec(spec), options)


def prepare_spec(spec: RunSpec) -> PreparedScenario:
    """Return the scenario of a run, with its numbers in; `HilBenchError` says what does not fit."""
    tables = nested(spec.tolerances)
    return prepare(
        spec.case.scenario, spec.parameters, seed=spec.seed, tables=tables, keeps_session=True
    )


def verdicts_of(run: Run) -> tuple[Verdict, ...]:
    """Return the verdict of a run on each requirement."""
    return tuple(_verdict(each) for each in run.findings)


def failed_run(spec: RunSpec, outcome: RunOutcome, problem: str) -> RunResult:
    """Return the result of a run without verdicts.

    Args:
        spec: the run.
        outcome: what became of it.
        problem: why.
    """
    name, bench, firmware = spec.case.name, spec.case.bench, spec.case.firmware
    short = problem[-_LONGEST_PROBLEM:]
    return RunResult(spec.key, name, bench, firmware, spec.seed, spec.values, outcome, short)


def check_case(case: Case) -> None:
    """Check that the files of a case are those of the campaign.

    Raises:
        ConfigError: they are not.
    """
    scenario = case.scenario
    if (scenario.path, case.digest) in _CHECKED:
        return
    files = controller_digest(scenario.controller, scenario.path.parent)
    if case_digest(scenario, prepare(scenario).config, files) != case.digest:
        wrong = "version of hil-bench, bench or firmware is not that of the campaign"
        right = "take the same to all machines, and leave it alone while a campaign runs"
        raise ConfigError(f"{case.name}: the {wrong}; {right}")
    _CHECKED.add((scenario.path, case.digest))


def _verdict(finding: Finding) -> Verdict:
    judgement = finding.judgement
    margin = judgement.margin
    reason, seen = reason_of(judgement), judgement.coverage.share
    return Verdict(finding.requirement.id, judgement.outcome.value, margin, reason, seen)
