"""Files ``*.scenario.toml`` as tests: an item a requirement, one run for all of a file."""

import hashlib
import pickle
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

import hil_bench
from hil_bench.abilities.common.pytest_options import option, seed_option
from hil_bench.abilities.scenario.judgement import RequirementOutcome
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.recorded import Finding
from hil_bench.abilities.scenario.results import (
    UNJUDGED,
    ScenarioResult,
    junit_properties,
    play_for_result,
    reason_of,
)
from hil_bench.abilities.scenario.run import prepare
from hil_bench.errors import HilBenchError


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
        for name in scenario.unjudged:
            yield UnjudgedItem.from_parent(self, name=name)

    def result(self) -> ScenarioResult:
        """Return the result of the scenario, which is played at the first call."""
        if self._result is None:
            self._result = played_once(self.config, self.path, self._play)
        return self._result

    def _play(self) -> ScenarioResult:
        return play_for_result(prepare(load_scenario(self.path), seed=seed_option(self.config)))


def played_once(
    config: pytest.Config, path: Path, play: Callable[[], ScenarioResult]
) -> ScenarioResult:
    """Return the result of a scenario, played by one worker of pytest-xdist for all of them.

    The others wait for it. Its result is in a file beside the workers' temporary folders; where
    the worker dies, the next one plays.

    Args:
        config: of this worker, or of a run without workers.
        path: of the scenario.
        play: plays it.
    """
    folder = _common_folder(config)
    if folder is None:
        return play()
    about = (path.resolve(), config.workerinput["testrunuid"], sys.version, hil_bench.__version__)  # type: ignore[attr-defined]
    file = folder / hashlib.sha256(repr(about).encode()).hexdigest()[:32]
    with _alone(file.with_suffix(".lock")):
        if not file.exists():
            result = play()
            partial = file.with_suffix(".partial")
            partial.write_bytes(pickle.dumps(result))
            partial.replace(file)
            return result
        kept: ScenarioResult = pickle.loads(file.read_bytes())  # noqa: S301 - this user's own
        return kept


def _common_folder(config: pytest.Config) -> Path | None:
    """Return a folder that the workers of a run have in common; None where there are none."""
    factory = getattr(config, "_tmp_path_factory", None)
    if factory is None or not hasattr(config, "workerinput"):
        return None
    folder: Path = factory.getbasetemp().parent / "hil-bench-scenarios"
    folder.mkdir(exist_ok=True)
    return folder


@contextmanager
def _alone(path: Path) -> Iterator[None]:
    """Wait until no other process holds a file, and hold it; the end of a process lets go of it.

    Yields:
        Nothing.
    """
    with path.open("ab") as file:
        if sys.platform == "win32":
            import msvcrt

            file.seek(0)
            while True:
                with suppress(OSError):  # after ten seconds, which a scenario may well take
                    msvcrt.locking(file.fileno(), msvcrt.LK_LOCK, 1)
                    break
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX)
        yield


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
            self.user_properties.append(("requirement_id", self.name))
            raise ScenarioFailedError(result.problem)
        finding = result.findings[self._number]
        self.user_properties += junit_properties(result, finding)
        if finding.judgement.outcome is not RequirementOutcome.PASSED:
            raise ScenarioFailedError(_explain(result, finding))

    def repr_failure(
        self, excinfo: pytest.ExceptionInfo[BaseException], style: object = None
    ) -> str:
        """Return the reason of a failure, without a traceback through the bench."""
        if isinstance(excinfo.value, ScenarioFailedError | HilBenchError):
            return str(excinfo.value)
        return str(super().repr_failure(excinfo, style))  # type: ignore[arg-type]

    def reportinfo(self) -> tuple[str, int, str]:
        """Return file, line and name."""
        return str(self.path), self._line - 1, f"{self.path.name}: {self.name}"


class UnjudgedItem(ScenarioItem):
    """A requirement that a scenario is about, and that it does not judge."""

    def runtest(self) -> None:
        """Fail as what is undecided does, without a run.

        Raises:
            ScenarioFailedError: always.
        """
        self.user_properties.append(("requirement_id", self.name))
        raise ScenarioFailedError(f"{self.name}: {UNJUDGED}")


def _explain(result: ScenarioResult, finding: Finding) -> str:
    judgement = finding.judgement
    lines = [
        f"{finding.requirement.id}: {finding.requirement.that}",
        f"{judgement.outcome}: {reason_of(judgement)}",
    ]
    return "\n".join([*lines, result.ending] if result.ending else lines)
