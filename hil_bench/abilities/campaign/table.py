"""Runs of a campaign, one after the other or on many processors, as a table."""

import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from itertools import islice
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, NamedTuple

from hil_bench.abilities.campaign.plan import Plan
from hil_bench.abilities.campaign.records import RunResult, RunSpec, read_campaign
from hil_bench.abilities.campaign.snapshot import Backend, local_backend
from hil_bench.abilities.campaign.store import Store, same_finding
from hil_bench.abilities.common.files import scratch_folder
from hil_bench.errors import ConfigError

if TYPE_CHECKING:
    import pandas as pd  # type: ignore[import-untyped]

# Doing a campaign: what is not done yet, and what came of all.


_FILE_RUNS = 500
"""Most runs in a file."""

_FILE_TIME = 10.0
"""Time after which a file is written [s]: what a power cut can cost."""


Note = Callable[[RunResult | None], None]
"""Is told of each run."""


class Shard(NamedTuple):
    """A part of a campaign: every `parts`-th run.

    Attributes:
        number: of the part, from 1.
        parts: how many there are.
    """

    number: int = 1
    parts: int = 1


WHOLE = Shard()


class Outcome(NamedTuple):
    """The outcome of a campaign.

    Attributes:
        results: in the order of the plan.
        missing: how many runs are not done yet.
        digest: of all results; the same wherever and in whatever order they were done.
    """

    results: Sequence[RunResult]
    missing: int
    digest: str


def execute(
    plan: Plan,
    store: Store,
    backend: Backend,
    shard: Shard = WHOLE,
    note: Note = lambda _result: None,
) -> None:
    """Do the runs of a plan that are not done yet; what is done is kept however this ends.

    Args:
        plan: the campaign.
        store: where results go.
        backend: does the runs.
        shard: the part of the campaign.
        note: is told of each result, and by None of each run that was done before.
    """
    done = store.keys()
    fresh: list[RunResult] = []
    due = monotonic() + _FILE_TIME
    try:
        for result in backend(_to_do(part_of(plan, shard), done, note)):
            fresh.append(result)
            note(result)
            if len(fresh) >= _FILE_RUNS or monotonic() >= due:
                batch, fresh = fresh, []
                store.write(batch)
                due = monotonic() + _FILE_TIME
    finally:
        store.write(fresh)


def part_of(plan: Iterable[RunSpec], shard: Shard) -> Iterator[RunSpec]:
    """Return the runs of a part."""
    return islice(plan, shard.number - 1, None, shard.parts)


def collect(plan: Plan, store: Store, shard: Shard = WHOLE) -> Outcome:
    """Collect the stored results of a plan's runs, in its order.

    Raises:
        ConfigError: a run was done twice, with two results.
    """
    found: dict[str, RunResult] = {}
    for result in store.results():
        other = found.setdefault(result.key, result)
        if not same_finding(other, result):
            wrong = f"run {result.key} was done twice, and the results differ"
            right = "the controller is not deterministic, or a time-out is too short"
            raise ConfigError(f"{store.folder}: {wrong}: {right}")
    results, missing = [], 0
    for spec in part_of(plan, shard):
        if spec.key in found:
            results.append(found[spec.key])
        else:
            missing += 1
    return Outcome(results, missing, digest_of(results))


def digest_of(results: Iterable[RunResult]) -> str:
    """Return the digest of results in their order, but for the words of crashed firmware."""
    digest = hashlib.sha256()
    for each in results:
        row = each._replace(problem="", values=dict(sorted(each.values.items())))
        digest.update(json.dumps(row, ensure_ascii=False).encode() + b"\n")
    return digest.hexdigest()


def _to_do(specs: Iterable[RunSpec], done: set[str], note: Note) -> Iterator[RunSpec]:
    """Yield the runs that are not done, each once."""
    given = set(done)
    for spec in specs:
        if spec.key in given:
            note(None)
        else:
            given.add(spec.key)
            yield spec


# The results of a campaign as a table, and the face for Python.


def run_campaign(
    path: str | os.PathLike[str],
    *,
    runs: int | None = None,
    sampler: str | None = None,
    seed: int | None = None,
    jobs: int = 0,
    output: str | os.PathLike[str] | None = None,
    progress: bool = False,
) -> "pd.DataFrame":
    """Return the results of a campaign, a row a run; those that are in `output` are not done again.

    The index is the run's key. Columns are scenario, bench, firmware, seed, a column a parameter in
    its own unit, outcome and problem; and of each requirement its outcome in a column of its id,
    its margin in ``ID margin``, and how much of its time was seen, 0 to 1, in ``ID seen``. A
    `ConfigError` says what is wrong with the files.

    Args:
        path: `campaign.toml`, or a scenario whose ranges are the space.
        runs: points of each scenario, in the place of the file's.
        sampler: ``grid``, ``sobol``, ``latin_hypercube`` or ``monte_carlo``, likewise.
        seed: of the sampler, likewise.
        jobs: processes; 0 for this one, where nothing ends a run that hangs.
        output: the folder for results; without it they are not kept.
        progress: whether to show a bar on standard error.
    """
    from tqdm import tqdm  # noqa: PLC0415 - an extra

    plan = Plan(read_campaign(Path(path)).changed(runs=runs, sampler=sampler, seed=seed))
    with ExitStack() as stack:
        folder = output or stack.enter_context(scratch_folder())
        store = Store(Path(folder), plan.firmware)
        backend = stack.enter_context(local_backend(jobs))
        with tqdm(total=len(plan), unit=" runs", disable=not progress) as bar:

            def note(_result: RunResult | None) -> None:
                bar.update()

            execute(plan, store, backend, note=note)
        return to_table(collect(plan, store).results)


def to_table(results: Sequence[RunResult]) -> "pd.DataFrame":
    """Return results as a pandas table, a row a run; see `run_campaign`."""
    import pandas as pd  # noqa: PLC0415 - an extra, and slow to import

    rows = []
    for each in results:
        row: dict[str, object] = {
            "key": each.key,
            "scenario": each.scenario,
            "bench": each.bench,
            "firmware": each.firmware,
            "seed": each.seed,
            **each.values,
            "outcome": each.outcome.value,
            "problem": each.problem,
        }
        for verdict in each.verdicts:
            row[verdict.id] = verdict.outcome
            row[f"{verdict.id} margin"] = verdict.margin
            row[f"{verdict.id} seen"] = verdict.seen
        rows.append(row)
    return pd.DataFrame(rows).set_index("key")
