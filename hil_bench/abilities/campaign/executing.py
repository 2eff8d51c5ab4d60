"""Doing a campaign: what is not done yet, and what came of all."""

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice
from time import monotonic
from typing import NamedTuple

from hil_bench.abilities.campaign.plan import Plan
from hil_bench.abilities.campaign.records import RunResult, RunSpec
from hil_bench.abilities.campaign.snapshot import Backend
from hil_bench.abilities.campaign.store import Store, same_finding
from hil_bench.errors import ConfigError

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
