"""Campaigns: runs a second of processor time, memory over many runs, one digest however they run.

    python benchmarks/campaign.py                       # the shortest run there is
    python benchmarks/campaign.py --runs 10000 --scenario examples/scenarios/settling.scenario.toml
    python benchmarks/campaign.py --dask
    python benchmarks/campaign.py --library --runs 100000   # 5 s each, the example in C

The digests of one process, of two, of three parts in another order, and of a campaign that was
killed half-way and went on must be the same. `--library` plays the example in C to and fro as a
shared library for 5 s; a million such runs are to take 18 core-hours at most. `--dask` adds a
cluster of two workers, one of which is killed half-way.
"""

import argparse
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import replace
from itertools import count
from pathlib import Path
from time import sleep

import occasion
from hil_bench.abilities.campaign.dask import DaskBackend
from hil_bench.abilities.campaign.plan import Plan
from hil_bench.abilities.campaign.records import RunResult, RunSpec, read_campaign
from hil_bench.abilities.campaign.snapshot import Backend, run_pool
from hil_bench.abilities.campaign.store import Store
from hil_bench.abilities.campaign.table import Shard, collect, execute

SHORT = """\
title = "Rest"
duration_s = 0.01
[parameters]
limit_bar = { value = 250.0, range = [1.0, 301.0] }
[[expect]]
id = "R-1"
that = "always axis1.P_A < limit_bar"
"""
LIBRARY = """\
title = "To and fro for 5 s"
duration_s = 5.0
[controller]
kind = "library"
library = "libposition_control.so"
settings = { targets_mm = "{target_mm},-20", speed_mm_s = 150, dwell_ms = 2000 }
[parameters]
target_mm = { value = 30.0, range = [10.0, 60.0] }
[[expect]]
id = "R-1"
that = "always axis1.P_A < 200 bar"
[[expect]]
id = "R-2"
that = "eventually abs(axis1.position - target_mm) < 0.5 mm"
"""
FIRMWARE = Path(__file__).parents[1] / "examples/firmware"


def resident_mb() -> float:
    """Return the memory that all processes of this program hold [MB]."""
    total = 0
    for status in Path("/proc").glob("[0-9]*/status"):
        text = ""
        with suppress(FileNotFoundError, ProcessLookupError):  # it has just ended
            text = status.read_text(encoding="utf-8")
        fields = dict(line.split(":", 1) for line in text.splitlines() if ":" in line)
        owner = {int(fields.get("Pid", 0)), int(fields.get("PPid", 0))}
        if own_id() in owner and "VmRSS" in fields:
            total += int(fields["VmRSS"].split()[0])
    return total / 1024


def own_id() -> int:
    """Return the number of this process."""
    return int(Path("/proc/self").resolve().name)


def watched(backend: Backend, every: int) -> Backend:
    """Return a backend that prints the memory now and then."""

    def run(specs: Iterable[RunSpec]) -> Iterator[RunResult]:
        for number, result in enumerate(backend(specs), 1):
            if number % every == 0:
                print(f"  {number} runs: {resident_mb():.0f} MB", flush=True)
            yield result

    return run


def measure(plan: Plan, folder: Path, jobs: int) -> str:
    """Do a campaign; return the digest of its results."""
    store = Store(folder, plan.firmware)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with run_pool(jobs) as pool:
        execute(plan, store, watched(pool, max(len(plan) // 5, 1)))
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    rate, hours = len(plan) / used, used / len(plan) * 1e6 / 3600
    print(
        f"{jobs} processes: {rate:.1f} runs a second of processor time, {1e3 / rate:.1f} ms a run, "
        f"start included; a million take {hours:.1f} core-hours",
        flush=True,
    )
    return collect(plan, store).digest


def in_parts(plan: Plan, folder: Path) -> str:
    """Do a campaign in three parts, the last first; return the digest of what they merge to."""
    with run_pool(1) as pool:
        for number in (3, 2, 1):
            execute(plan, Store(folder / str(number), plan.firmware), pool, Shard(number, 3))
    return collect(plan, Store(folder, plan.firmware)).digest


def killed(plan: Plan, folder: Path, scenario: Path) -> str:
    """Kill a campaign once some of it is kept, and go on; return the digest."""
    words = [sys.executable, "-m", "hil_bench", "campaign", str(scenario), "--jobs=1"]
    words += [f"--runs={plan.campaign.runs}", "--output", str(folder), "--json"]
    program = subprocess.Popen(words, stdout=subprocess.DEVNULL)  # noqa: S603 - our own
    store = Store(folder, plan.firmware)
    while program.poll() is None:
        try:
            program.wait(0.2)
        except subprocess.TimeoutExpired:
            if store.keys():
                program.send_signal(signal.SIGKILL)
    kept = len(store.keys())
    with run_pool(1) as pool:
        execute(plan, store, pool)
    print(f"killed with {kept} of {len(plan)} runs kept, the rest done by the next process")
    return collect(plan, store).digest


def on_dask(plan: Plan, folder: Path) -> str:
    """Do a campaign on two workers, of which one is killed half-way; return the digest."""
    os.environ["DASK_DISTRIBUTED__WORKER__DAEMON"] = "False"
    where = folder / "scheduler.json"
    start = [sys.executable, "-m"]
    file = f"--scheduler-file={where}"
    words = [[*start, "distributed.cli.dask_scheduler", file, "--port=0", "--no-dashboard"]]
    words += [[*start, "distributed.cli.dask_worker", file, "--nthreads=1", "--no-nanny"]] * 2
    with ExitStack() as stack:
        programs = []
        for each in words:
            program = subprocess.Popen(each, stderr=subprocess.DEVNULL)  # noqa: S603 - our own
            stack.callback(program.wait)
            stack.callback(program.kill)
            programs.append(program)
        address = wait_for_address(where)
        backend = stack.enter_context(DaskBackend(address, task_runs=20))
        memory = [scheduler_mb(programs[0])]
        seen = count()

        def note(_result: RunResult | None) -> None:
            if next(seen) == len(plan) // 2:
                memory.append(scheduler_mb(programs[0]))
                programs[1].kill()

        store = Store(folder / "dask", plan.firmware)
        execute(plan, store, backend, note=note)
        memory.append(scheduler_mb(programs[0]))
    shown = ", ".join(f"{each:.0f}" for each in memory)
    print(f"scheduler's memory at the start, half-way and at the end: {shown} MB")
    return collect(plan, store).digest


def wait_for_address(path: Path) -> str:
    """Return the address that a scheduler writes down once it listens."""
    while not path.exists() or not path.read_text(encoding="utf-8").strip():
        sleep(0.1)
    address: str = json.loads(path.read_text(encoding="utf-8"))["address"]
    return address


def scheduler_mb(program: "subprocess.Popen[bytes]") -> float:
    """Return the memory that a process holds [MB]."""
    text = Path(f"/proc/{program.pid}/status").read_text(encoding="utf-8")
    fields = dict(line.split(":", 1) for line in text.splitlines() if ":" in line)
    return int(fields["VmRSS"].split()[0]) / 1024


def write_library(folder: Path) -> Path:
    """Build the example in C as a library; return the scenario that plays it."""
    if not (shutil.which("make") and shutil.which("cc")):
        occasion.missing("the example in C", "there is no make, or no C compiler")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    goal = str(folder / "libposition_control.so")
    words = ["make", "--silent", "-C", str(FIRMWARE), f"BUILD={folder}", goal]
    subprocess.run(words, check=True, env=os.environ | {"PATH": path})  # noqa: S603 - our own
    scenario = folder / "library.scenario.toml"
    scenario.write_text(LIBRARY, encoding="utf-8")
    return scenario


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=600)
    parser.add_argument("--scenario", type=Path, help="the shortest there is, without it")
    parser.add_argument("--dask", action="store_true", help="a cluster of two workers, too")
    parser.add_argument("--library", action="store_true", help="the example in C, 5 s a run")
    options = occasion.arguments(parser, runs=20)
    with tempfile.TemporaryDirectory(prefix="hil-bench-") as name:
        folder = Path(name)
        scenario = options.scenario or folder / "rest.scenario.toml"
        if options.library:
            scenario = write_library(folder)
        elif not options.scenario:
            scenario.write_text(SHORT, encoding="utf-8")
        plan = Plan(replace(read_campaign(scenario), runs=options.runs))
        digests = {
            "1 process": measure(plan, folder / "one", 1),
            "2 processes": measure(plan, folder / "two", 2),
            "3 parts": in_parts(plan, folder / "parts"),
            "killed": killed(plan, folder / "killed", scenario),
        }
        if options.dask:
            digests["Dask"] = on_dask(plan, folder)
    for how, digest in digests.items():
        print(f"{how:12} {digest[:16]}")
    sys.exit(len(set(digests.values())) - 1)


if __name__ == "__main__":
    main()
