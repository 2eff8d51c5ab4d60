"""The results of a campaign as a table, and the face for Python."""

import os
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from hil_bench.abilities.campaign.executing import collect, execute
from hil_bench.abilities.campaign.plan import Plan
from hil_bench.abilities.campaign.reading import read_campaign
from hil_bench.abilities.campaign.records import RunResult
from hil_bench.abilities.campaign.snapshot import local_backend
from hil_bench.abilities.campaign.store import Store
from hil_bench.scratch import scratch_folder

if TYPE_CHECKING:
    import pandas as pd  # type: ignore[import-untyped]


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
