"""The runs of a search that was interrupted, kept until the same search has come to its end."""

import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path

from hil_bench.abilities.campaign.identity import run_key
from hil_bench.abilities.campaign.pool import Backend
from hil_bench.abilities.campaign.records import Case, RunResult, RunSpec
from hil_bench.abilities.campaign.store import Store
from hil_bench.errors import ConfigError


class KeptRuns:
    """Does runs, but those that an earlier search has left.

    Args:
        backend: does the runs.
        parent: the folder that the kept runs have a folder in.
        case: what is searched; after a change of scenario, its parameters, bench or firmware it is
            another one.

    Attributes:
        folder: where runs are kept; only there between an interruption and the end of the search.
    """

    def __init__(self, backend: Backend, parent: Path, case: Case) -> None:
        fixed = {each.name: each.value for each in case.scenario.parameters}
        digest = run_key(case.digest, fixed, {}, None)
        self.folder = parent / f"{case.name}.{digest[:8]}.interrupted"
        self._backend = backend
        self._done: dict[str, RunResult] = {}
        if self.folder.is_dir():
            self._done = {each.key: each for each in Store(self.folder, {}).results()}
        self._fresh: dict[str, RunResult] = {}  # a run may come twice, as while a failure is shrunk

    def __call__(self, specs: Iterable[RunSpec]) -> Iterator[RunResult]:
        """Do runs, as a `Backend`.

        Yields:
            What came of each: of those that were done before, at once.
        """
        missing = []
        for spec in specs:
            if spec.key in self._done:
                yield self._done[spec.key]
            else:
                missing.append(spec)
        for result in self._backend(missing):
            self._fresh.setdefault(result.key, result)
            yield result

    def keep(self) -> str:
        """Write the runs of this search beside those of earlier ones; return why that failed."""
        try:
            if self._fresh:
                Store(self.folder, {}).write(list(self._fresh.values()))
        except ConfigError as error:
            return str(error)
        return ""

    def drop(self) -> str:
        """Remove the folder, since the search has come to its end."""
        shutil.rmtree(self.folder, ignore_errors=True)
        return ""
