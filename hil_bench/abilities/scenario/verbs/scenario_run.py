"""`hil-bench run --scenario`: a scenario in real time while people watch, then the verdicts.

Without a bus the scenario's own controller drives. With one, a controller there does.
"""

import argparse
import contextlib
import functools
import logging
import math
from collections.abc import Iterator

from hil_bench.abilities.recording.options import recording_code, recording_wish, report_lines
from hil_bench.abilities.recording.report import RecordingReport
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.recorded import Finding
from hil_bench.abilities.scenario.records import FirmwareStep, Scenario
from hil_bench.abilities.scenario.resolve import PreparedScenario, parameter_values
from hil_bench.abilities.scenario.results import play_for_result
from hil_bench.abilities.scenario.run import PlayOptions, prepare, prepare_on
from hil_bench.abilities.scenario.stage import Stage
from hil_bench.abilities.scenario.verbs import scenario_report
from hil_bench.abilities.scenario.verbs.scenario_arguments import has_bus, read_parameter
from hil_bench.abilities.scenario.verbs.scenario_view import shown_stage
from hil_bench.bench.session import Session
from hil_bench.bench.virtual_bench import VirtualBench
from hil_bench.cli.arguments import load_bench_config
from hil_bench.cli.bench_events import BenchEvents
from hil_bench.cli.exit_codes import Ending, ExitCode, Interruption, interruption, worst
from hil_bench.cli.helpers import Helpers
from hil_bench.cli.paced_run import Guest, clock_of, run_bench
from hil_bench.cli.results import is_silent, print_results
from hil_bench.cli.run_setup import watched_run
from hil_bench.cli.status_line import Field, StatusLine, bench_status, bench_status_row
from hil_bench.errors import ConfigError
from hil_bench.outside.helper_process import Snapshot

logger = logging.getLogger(__name__)

_NOBODY = (
    "no controller on the bus has sent a frame or written a register; without -i, -c and --hub its "
    "own one drives"
)
_LATE = 0.1  # how much a run may be behind real time without a word [s]


def run(args: argparse.Namespace) -> int:
    """Play the scenario, print what was found and return the exit code."""
    scenario = load_scenario(args.scenario)
    given = dict(read_parameter(text) for text in args.given)
    if has_bus(args):
        return _run_on_bus(args, scenario, given)
    return _run_alone(args, prepare(scenario, given, seed=args.seed))


def _run_on_bus(args: argparse.Namespace, scenario: Scenario, given: dict[str, float]) -> int:
    """Play a scenario on a bus, where another program is the controller.

    Raises:
        ConfigError: the scenario starts or kills firmware, or the bench never ran.
    """
    for step in scenario.steps:
        if isinstance(step, FirmwareStep):
            right = "leave -i, -c and --hub out"
            raise ConfigError(f"{step.place}: nothing starts firmware on a bus; {right}")
    args.config = scenario.bench_path
    config = load_bench_config(args)
    values = parameter_values(scenario, given)
    prepared = prepare_on(config, scenario, values, drives_itself=False)
    return run_bench(args, config, lambda session: _Played(prepared, session).guest())


class _Played:
    """A scenario on a bench that a bus drives.

    Args:
        prepared: the scenario.
        session: the bench, before its first tick.
    """

    def __init__(self, prepared: PreparedScenario, session: Session) -> None:
        self._scenario = prepared.scenario
        self._stage = Stage(prepared, session)
        self._shown = shown_stage(prepared, self._stage)
        self._is_awaited = prepared.scenario.controller is not None

    def guest(self) -> Guest:
        """Return the guest that the run hosts."""
        director = self._stage.director
        return Guest(lambda: director.is_over, self._lines, self._content, self._shown, self._code)

    def _code(self) -> ExitCode:
        return scenario_report.exit_code_for(self.findings, self._scenario.unjudged)

    @functools.cached_property
    def findings(self) -> tuple[Finding, ...]:
        """The judgement on each requirement; only when the run is over."""
        return self._stage.judge((_NOBODY,) if self._is_awaited and self._stage.is_silent else ())

    def _lines(self) -> Iterator[str]:
        yield f"{self._scenario.path}: {self._scenario.title}"
        yield from scenario_report.finding_lines(self.findings, self._scenario.unjudged)

    def _content(self) -> dict[str, object]:
        path = str(self._scenario.path)
        return {
            "scenario": {"path": path, "findings": scenario_report.finding_content(self.findings)}
        }


def _run_alone(args: argparse.Namespace, prepared: PreparedScenario) -> int:
    """Play a scenario on a bus inside this process, where its own controller drives."""
    with interruption() as wish:
        company = _Company(args, prepared, wish)
        options = PlayOptions(record=recording_wish(args), beside=company.beside)
        result = play_for_result(prepared, options)
    ending = Ending(args)
    ending.take(scenario_report.exit_code_of_results([result]), company.code, wish.code)
    lines = (*scenario_report.result_lines([result]), *company.lines())
    content = {"scenario": scenario_report.result_content(result), "recording": company.recording}
    with ending.going_on():
        print_results(args, lines, content)
    return ending.code


class _Company:
    """The company of a run: real time, the status line, and those who watch.

    Args:
        args: the command line.
        prepared: what is played.
        wish: whether somebody wants the end.
    """

    def __init__(
        self, args: argparse.Namespace, prepared: PreparedScenario, wish: Interruption
    ) -> None:
        self._args, self._prepared, self._wish = args, prepared, wish
        self._clock = clock_of(args.speed)
        self._behind = 0.0
        self._bench: VirtualBench | None = None
        self._helpers = Helpers([])

    @property
    def recording(self) -> RecordingReport | None:
        """The report on the files of --record, None without it or where no bench ran."""
        return None if self._bench is None else self._bench.recording

    @property
    def code(self) -> ExitCode:
        """The exit code of what was lost beside the run."""
        return worst(recording_code(self.recording), self._helpers.code)

    def lines(self) -> list[str]:
        """Return the lateness and the recording of the run, a line a fact."""
        lines = [] if self.recording is None else report_lines(self.recording)
        if self._behind >= _LATE:
            late = f"the run was up to {self._behind:.1f} s behind real time"
            lines.append(f"  {late}; its verdicts count bench time")
        return lines

    @contextlib.contextmanager
    def beside(self, bench: VirtualBench, stage: Stage) -> Iterator[None]:
        """Hold a run to real time and let people watch it.

        Args:
            bench: that is to run.
            stage: the scenario on it.

        Yields:
            Once, before the first tick.
        """
        session, config = bench.session, bench.config
        channels, fields = bench_status(bench.bench)
        snapshot = Snapshot(1 + len(channels))
        line = StatusLine(
            snapshot, [[Field("{:6.1f} s", 1.0), *fields]], wanted=not is_silent(self._args)
        )
        self._bench = bench
        self._helpers = helpers = Helpers(
            [line] if line.is_shown else [],
            ends_on_loss=self._args.end_on_loss,
            has_lost_data=lambda: recording_code(bench.recording) is not ExitCode.DONE,
        )
        events = BenchEvents(config, bench.bench, logger.warning)
        start = self._clock.now()
        watched = watched_run(self._args, config, session, work=shown_stage(self._prepared, stage))
        with line, contextlib.closing(helpers), watched as look_after:

            def look(now: int) -> None:
                snapshot.write((now * 1e-9, *bench_status_row(bench.bench)))
                helpers.look()
                events.look(now)
                if look_after is not None:
                    look_after()
                if self._wish.requested or session.controls.is_over or helpers.is_over:
                    stage.end()
                self._wait(start + now)

            session.watch(ticks=look)
            yield

    def _wait(self, due: int) -> None:
        if math.isfinite(self._args.speed):
            self._behind = max(self._behind, (self._clock.now() - due) * 1e-9)
            self._clock.sleep_until(due)
