"""A campaign on a Dask cluster of two workers, one of which is killed."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from support.campaigns import write_rest

from hil_bench.abilities.campaign.plan import Plan
from hil_bench.abilities.campaign.records import read_campaign
from hil_bench.abilities.campaign.snapshot import perform_here
from hil_bench.abilities.campaign.store import Store
from hil_bench.abilities.campaign.table import collect, execute

RUNS = 24

# In a process of its own: the cluster leaves threads and sockets behind, which are none of ours.
PROGRAM = """\
import os, signal, sys
from dataclasses import replace
from pathlib import Path
import dask
from distributed import LocalCluster
from hil_bench.abilities.campaign.dask import DaskBackend
from hil_bench.abilities.campaign.table import collect, execute
from hil_bench.abilities.campaign.plan import Plan
from hil_bench.abilities.campaign.records import read_campaign
from hil_bench.abilities.campaign.store import Store

def main():
    path, folder, runs = sys.argv[1:]
    dask.config.set({"distributed.worker.daemon": False})
    plan = Plan(replace(read_campaign(Path(path)), runs=int(runs)))
    store = Store(Path(folder), {})
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with LocalCluster(**options) as cluster, DaskBackend(cluster.scheduler_address, 4) as backend:
        victims = list(backend._client.run(os.getpid).values())[:1]
        def note(result):
            while result is not None and victims:
                os.kill(victims.pop(), signal.SIGKILL)
        execute(plan, store, backend, note=note)
        print(not victims, collect(plan, store).digest)

if __name__ == "__main__":
    main()
"""


@pytest.mark.long  # a scheduler, two workers and their processes import the whole package
def test_a_cluster_that_loses_a_worker_finds_the_same(tmp_path, make_file):
    pytest.importorskip("distributed")
    path = write_rest(tmp_path)
    plan = Plan(replace(read_campaign(path), runs=RUNS))
    here = Store(tmp_path / "here", {})
    execute(plan, here, perform_here)
    program = make_file("cluster.py", PROGRAM)
    words = [sys.executable, str(program), str(path), str(tmp_path / "there"), str(RUNS)]
    ended = subprocess.run(words, capture_output=True, text=True, timeout=600, check=False)  # noqa: S603
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.split() == ["True", collect(plan, here).digest]


@pytest.mark.long  # the library tries for ten seconds
def test_no_scheduler_is_one_line(tmp_path, capsys):
    pytest.importorskip("distributed")
    from hil_bench import cli  # noqa: PLC0415 - beside the import above

    path = write_rest(Path(tmp_path))
    assert cli.main(["campaign", str(path), "--runs=1", "--dask=tcp://127.0.0.1:1"]) == 3
    errors = [line for line in capsys.readouterr().err.splitlines() if "error:" in line]
    (error,) = errors
    assert error.endswith("127.0.0.1:1: no scheduler answers there; start it with: dask scheduler")
