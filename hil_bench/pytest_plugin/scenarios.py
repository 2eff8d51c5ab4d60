"""Files ``*.scenario.toml`` as tests: an item a requirement, one run for all of a file."""

from collections.abc import Iterator

import pytest

from hil_bench.errors import HilBenchError
from hil_bench.pytest_plugin.options import option
from hil_bench.scenario.judgement import RequirementOutcome
from hil_bench.scenario.load import load_scenario
from hil_bench.scenario.recorded import Finding
from hil_bench.scenario.results import (
    ScenarioResult,
    junit_properties,
    play_for_result,
    reason_of,
)
from hil_bench.scenario.run import prepare


class ScenarioFailedError(Exception):
    """A requirement does not hold; the message says why."""


class ScenarioFile(pytest.File):
    """A scenario; it is played when the first of its requirements is asked for."""

    _result: ScenarioResult | None = None

    def collect(self) -> Iterator["ScenarioItem"]:
        """Yield a test for each requirement; a `CollectError` says what is wrong in the file."""
        try:
            scenario = load_scenario(self.path)
        except HilBenchError as error:
            raise self.CollectError(str(error)) from None
        for number, expectation in enumerate(scenario.expectations):
            item = ScenarioItem.from_parent(self, name=expectation.id)
            item.place(number, expectation.place.line)
            yield item

    def result(self) -> ScenarioResult:
        """Return what came of the scenario."""
        if self._result is None:
            seed = option(self.config, "seed")
            prepared = prepare(load_scenario(self.path), seed=None if seed is None else int(seed))
            self._result = play_for_result(prepared)
        return self._result


class ScenarioItem(pytest.Item):
    """A requirement of a scenario."""

    parent: ScenarioFile
    _number = 0
    _line = 1

    def place(self, number: int, line: int) -> None:
        """Take its number among the requirements of the file, and the line that it stands in."""
        self._number, self._line = number, line

    def setup(self) -> None:
        """Skip it on a physical bench, where scenarios do not run."""
        if option(self.config, "interface"):
            pytest.skip("scenarios need the virtual bench, which --hil-interface turns off")

    def runtest(self) -> None:
        """Hold the run against the requirement.

        Raises:
            ScenarioFailedError: it does not hold, is undecided, or was not exercised.
        """
        result = self.parent.result()
        if result.problem:
            raise ScenarioFailedError(result.problem)
        finding = result.findings[self._number]
        self.user_properties += junit_properties(result, finding)
        if finding.judgement.outcome is not RequirementOutcome.PASSED:
            raise ScenarioFailedError(_explain(result, finding))

    def repr_failure(
        self, excinfo: pytest.ExceptionInfo[BaseException], style: object = None
    ) -> str:
        """Return what is wrong, without a traceback through the bench."""
        if isinstance(excinfo.value, ScenarioFailedError | HilBenchError):
            return str(excinfo.value)
        return str(super().repr_failure(excinfo, style))  # type: ignore[arg-type]

    def reportinfo(self) -> tuple[str, int, str]:
        """Return file, line and name."""
        return str(self.path), self._line - 1, f"{self.path.name}: {self.name}"


def _explain(result: ScenarioResult, finding: Finding) -> str:
    judgement = finding.judgement
    lines = [
        f"{finding.requirement.id}: {finding.requirement.that}",
        f"{judgement.outcome}: {reason_of(judgement)}",
    ]
    return "\n".join([*lines, result.ending] if result.ending else lines)
