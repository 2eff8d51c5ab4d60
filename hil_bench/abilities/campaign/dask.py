"""Runs on the workers of a Dask cluster, many in a task."""

import multiprocessing
import threading
from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Any, Self

from hil_bench.abilities.campaign.records import RunResult, RunSpec
from hil_bench.abilities.campaign.snapshot import run_pool
from hil_bench.abilities.campaign.store import program_identity
from hil_bench.abilities.scenario.pool import Pool
from hil_bench.errors import BusError, ConfigError

TASK_RUNS = 100
"""Runs in a task: what a worker that dies costs."""

_TASKS = 2  # that wait for each thread of the workers: the scheduler holds no more
_CONNECT_TIME = 10.0  # [s]
_KEPT = "all earlier runs are kept, and the same command goes on from there"


_POOLS: dict[int, Pool[RunSpec, RunResult]] = {}
"""On a worker: the process of each of its threads, from task to task; they end with it."""


class DaskBackend:
    """Does runs on a cluster; a task whose worker dies goes to another one.

    Args:
        address: of the scheduler, as in ``tcp://host:8786``.
        task_runs: runs in a task.

    Raises:
        ConfigError: `distributed` is not installed, or a worker has another version of hil-bench.
        BusError: the scheduler cannot be reached.
    """

    def __init__(self, address: str, task_runs: int = TASK_RUNS) -> None:
        try:
            from distributed import Client  # noqa: PLC0415 - an extra
        except ImportError:
            right = "install it with: pip install 'hil-bench[dask]'"
            raise ConfigError(f"--dask needs distributed; {right}") from None
        self._address, self._task_runs = address, task_runs
        try:
            self._client: Any = Client(  # type: ignore[no-untyped-call]
                address, timeout=_CONNECT_TIME, set_as_default=False
            )
        except ValueError as error:
            right = "give one as in tcp://host:8786"
            raise ConfigError(f"--dask {address}: {error}; {right}") from None
        except OSError:
            raise BusError(
                f"--dask {address}: no scheduler answers there; start it with: dask scheduler"
            ) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._client.close(timeout=1.0)

    def __call__(self, specs: Iterable[RunSpec]) -> Iterator[RunResult]:
        """Do runs.

        Yields:
            What came of each, in the order in which their tasks end.
        """
        from distributed import as_completed  # noqa: PLC0415 - an extra

        self._check_workers()
        waiting: Iterator[RunSpec] = iter(specs)
        batches = iter(lambda: list(islice(waiting, self._task_runs)), [])
        done: Any = as_completed(loop=self._client.loop)  # type: ignore[no-untyped-call]
        while True:
            for batch in islice(batches, max(_TASKS * self._threads() - done.count(), 0)):
                done.add(self._client.submit(perform_batch, batch, pure=False))
            if done.is_empty():
                return
            yield from self._result(next(done))

    def _result(self, future: Any) -> list[RunResult]:  # noqa: ANN401 - distributed has no types
        """Return the results of a task.

        Raises:
            ConfigError: the files on its worker are not those of the campaign.
            BusError: the scheduler is gone, or no worker lives long enough.
        """
        try:
            results: list[RunResult] = future.result()
        except ConfigError:
            raise
        except Exception as error:
            reason = " ".join(f"{type(error).__name__}: {error}".split())[:200]
            raise BusError(f"--dask {self._address}: {reason}; {_KEPT}") from None
        return results

    def _threads(self) -> int:
        return max(sum(int(each) for each in self._client.nthreads().values()), 1)

    def _check_workers(self) -> None:
        """Refuse workers with another version.

        Raises:
            ConfigError: there is one.
        """
        own = program_identity()
        for worker, found in self._client.run(program_identity).items():
            if found != own:
                wrong = f"worker {worker} has hil-bench {found}, and this is {own}"
                raise ConfigError(f"--dask {self._address}: {wrong}; install one version on all")


def perform_batch(specs: list[RunSpec]) -> list[RunResult]:
    """Perform a batch of runs; a worker of the cluster calls it.

    Raises:
        ConfigError: the worker may not have processes of its own.
    """
    if multiprocessing.current_process().daemon:
        right = "start it with DASK_DISTRIBUTED__WORKER__DAEMON=False, or with --no-nanny"
        raise ConfigError(f"the Dask worker may not start processes for the runs; {right}")
    thread = threading.get_ident()
    pool = _POOLS.pop(thread, None) or run_pool(1)
    try:
        results = list(pool(specs))
    except BaseException:
        pool.close()
        raise
    _POOLS[thread] = pool
    return results
