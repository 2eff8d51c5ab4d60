"""Snapshots: runs that go on from a copy have the results of runs from the start."""

import os
import shutil
import signal
import threading
from pathlib import Path

import pytest
from support.chip_programs import CAN_BUILD, WHY_NOT, build_example

from hil_bench.abilities.campaign import snapshot
from hil_bench.abilities.campaign.plan import make_spec, own_case, space_of
from hil_bench.abilities.campaign.snapshot import (
    Snapshots,
    can_branch,
    first_difference,
    perform,
    prepare_spec,
)
from hil_bench.abilities.scenario.load import load_scenario

pytestmark = [
    pytest.mark.skipif(not Path("/proc/thread-self/children").exists(), reason="needs Linux"),
    pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning"),
]

LOAD = """
title = "The load changes twice"
duration_s = 0.5
{controller}
[parameters]
at_s = {{ value = 0.3, range = [0.2, 0.45] }}
load_kN = {{ value = 10.0, range = [-20.0, 20.0] }}
limit_bar = {{ value = 60.0, range = [1.0, 300.0] }}
[[step]]
at_s = 0.15
set = {{ "axis1.load" = "5 kN" }}
over_s = 0.2
[[step]]
at_s = "at_s"
set = {{ "axis1.load" = "load_kN" }}
[[expect]]
id = "T-1"
that = "always axis1.P_A < limit_bar"
[[expect]]
id = "T-2"
that = "always abs(axis1.position) < 100 mm"
"""


def specs(path, *points):
    scenario = load_scenario(path)
    case, space = own_case(scenario), space_of(scenario)
    return [make_spec(case, point, space, None, 60.0) for point in points]


def point(at_s, load_kn, limit_bar=60.0):
    return {"at_s": at_s, "load_kN": load_kn, "limit_bar": limit_bar}


POINTS = (
    point(0.3, 10.0),
    point(0.3, -10.0),
    point(0.4, 10.0, 1.0),
    point(0.25, 10.0),  # before the snapshot
    point(0.26, 15.0, 300.0),
    point(0.26, 15.0, 200.0),
)


@pytest.fixture
def load(make_file):
    return make_file("load.scenario.toml", LOAD.format(controller=""))


def test_a_copy_ends_as_a_run_from_the_start(load):
    runs = specs(load, *POINTS)
    snapshots, pids = Snapshots(), []
    try:
        for run in runs:
            assert snapshots.perform(run) == perform(run)
            pids.append(snapshots.pid)
    finally:
        snapshots.close()
    # The second one takes it; one that differs earlier takes another, which lasts.
    assert pids[0] is None
    assert pids[1] == pids[2] != pids[3]
    assert pids[3] == pids[4] == pids[5]
    assert len({perform(run).verdicts for run in runs}) >= 5


def test_a_killed_snapshot_costs_no_run(load):
    runs = specs(load, *POINTS[:3])
    snapshots = Snapshots()
    try:
        for run in runs[:2]:
            snapshots.perform(run)
        assert snapshots.pid is not None
        os.kill(snapshots.pid, signal.SIGKILL)
        assert snapshots.perform(runs[2]) == perform(runs[2])
    finally:
        snapshots.close()


def begin_thread():
    threading.Thread(target=threading.Event().wait, daemon=True).start()


@pytest.mark.parametrize(("when", "is_taken"), [("at each fork", True), ("in the run", False)])
def test_a_thread_of_the_run_itself_is_not_copied(load, monkeypatch, when, is_taken):
    """Those that a library starts anew at each fork, as pyarrow does, are in the copy, too."""
    keep, play = snapshot._keep, snapshot.play

    def keep_with_thread(*arguments):
        begin_thread()
        keep(*arguments)

    def play_with_thread(prepared, *options):
        if options:  # not in this process
            begin_thread()
        return play(prepared, *options)

    if is_taken:
        monkeypatch.setattr(snapshot, "_keep", keep_with_thread)
    else:
        monkeypatch.setattr(snapshot, "play", play_with_thread)
    snapshots = Snapshots()
    try:
        for run in specs(load, *POINTS[:2]):
            assert snapshots.perform(run) == perform(run)
        assert (snapshots.pid is not None) is is_taken, when
    finally:
        snapshots.close()


def test_steps_are_common_up_to_the_first_that_differs(load):
    first, second, third = (prepare_spec(run).actions for run in specs(load, *POINTS[:3]))
    # Ticks of 1 ms: the load changes at 0.3 s, another one or later.
    assert first_difference(first, second) == 300
    assert first_difference(second, third) == 300
    assert first_difference(first, first) > 500
    assert first_difference(first, first[:-1]) == 300


@pytest.mark.long
@pytest.mark.skipif(not CAN_BUILD, reason=WHY_NOT)
def test_a_chip_is_copied_with_its_bench(tmp_path):
    pytest.importorskip("unicorn")
    (tmp_path / "bench.toml").write_text("[bench]\ntick_us = 500\n")
    table = 'kind = "elf"\nprogram = "stm32f4.elf"\nchip = "STM32F407"'
    check_copies(tmp_path, "stm32f4.elf", table, bench='bench = "bench.toml"\n')


@pytest.mark.skipif("CI" not in os.environ and not shutil.which("cc"), reason="needs a C compiler")
def test_a_library_is_copied_with_its_bench(tmp_path):
    name = "libposition_control.so"
    settings = 'settings = { targets_mm = "50,-50" }'
    check_copies(tmp_path, name, f'kind = "library"\nlibrary = "{name}"\n{settings}')


def check_copies(folder, goal, table, bench=""):
    """Check that runs with the example in C end as those from the start, from a snapshot."""
    build_example(folder, goal)
    path = folder / "example.scenario.toml"
    path.write_text(bench + LOAD.format(controller=f"[controller]\n{table}\n"))
    runs = specs(path, *POINTS[:3])
    assert can_branch(prepare_spec(runs[0]))
    snapshots = Snapshots()
    try:
        found = [snapshots.perform(run) for run in runs]
        assert snapshots.pid is not None
    finally:
        snapshots.close()
    assert found == [perform(run) for run in runs]
