"""Campaigns of a scenario with margins in closed form: keys, resuming, merging, processes."""

import subprocess
import sys
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from support.campaigns import REST, margin_of, rest_pressures, run_result, write_rest

import hil_bench
from device_profiles import VALVE_408
from hil_bench import ConfigError
from hil_bench.abilities.campaign import store
from hil_bench.abilities.campaign.plan import Plan
from hil_bench.abilities.campaign.records import RunOutcome, Verdict, read_campaign
from hil_bench.abilities.campaign.snapshot import failed_run, perform_here, run_pool
from hil_bench.abilities.campaign.store import Store
from hil_bench.abilities.campaign.summary import summarise
from hil_bench.abilities.campaign.table import Shard, collect, execute, to_table
from hil_bench.abilities.scenario.reach import CERTAIN
from hil_bench.cli import main

RUNS = 8


@pytest.fixture
def plan(tmp_path):
    return Plan(replace(read_campaign(write_rest(tmp_path)), runs=RUNS))


def counted(done):
    def backend(specs):
        for spec in specs:
            done.append(spec.key)
            yield from perform_here([spec])

    return backend


@pytest.mark.parametrize(
    ("limit", "code"),
    [
        (30, 1),  # P_A is 48 bar at rest: the two runs that were done fail
        (250, 130),
        (4000, 130),  # beyond each machine
    ],
)
def test_an_interrupted_campaign_judges_the_runs_that_are_done(
    limit, code, tmp_path, cli, monkeypatch
):
    def interrupted(specs):
        for number, spec in enumerate(specs):
            if number == 2:
                raise KeyboardInterrupt
            yield from perform_here([spec])

    backend = "hil_bench.abilities.campaign.verbs.campaign.local_backend"
    monkeypatch.setattr(backend, lambda _jobs: nullcontext(interrupted))
    path = write_rest(tmp_path, REST.replace("250.0, range = [1.0, 301.0]", f"{limit}.0"))
    words = ["campaign", str(path), "--runs=5", f"--output={tmp_path / 'out'}"]
    said = cli(words, code)
    assert "out: interrupted; what is done is kept" in said.err
    assert ("R-1: cannot fail" in said.err) == (limit == 4000)
    what = "failed" if code == 1 else "passed"
    assert said.out.startswith(f"2 runs: 2 {what}; 3 not done yet")


def test_a_warning_of_several_variants_comes_once_with_their_number(tmp_path, cli):
    """Each variant loads its bench and the EDS file several times, at the ends of ranges, too."""
    text = REST.replace("[1.0, 301.0]", "[200.0, 301.0]").replace("P_B < 200", "P_B < 5000")
    scenario = write_rest(tmp_path, text)
    eds = VALVE_408.read_text(encoding="ascii").replace("$NODEID+0x200", "0x601")
    (tmp_path / "vendor.eds").write_text(eds, encoding="ascii")
    nodes = '[nodes]\none = { node_id = 20, eds = "vendor.eds" }\n'
    valve = 'valve = { profile = "valve_408", node_id = 1 }\n'
    for name, seed in (("a", 1), ("b", 2)):
        (tmp_path / f"{name}.toml").write_text(f"[bench]\nseed = {seed}\n{nodes}{valve}")
    path = tmp_path / "c.toml"
    path.write_text(f'scenarios = ["{scenario.name}"]\nbenches = ["a.toml", "b.toml"]\nruns = 1\n')
    said = cli(["campaign", str(path), f"--output={tmp_path / 'out'}"]).err
    for warning in ("which no PDO may have; RPDO1 is off", f"R-2: {CERTAIN}"):
        assert said.count(warning) == said.count(f"{warning} (in 2 variants)") == 1


def test_every_margin_is_the_distance_from_its_limit(plan, tmp_path):
    store = Store(tmp_path / "out", {})
    execute(plan, store, perform_here)
    results = collect(plan, store).results
    assert [each.values for each in results] == [spec.values for spec in plan]
    for each in results:
        expected = margin_of(each.values["limit_bar"])
        assert each.verdicts[0].margin == pytest.approx(expected, rel=1e-6)
        assert each.outcome == ("passed" if expected > 0 else "failed")
        assert each.verdicts[1].margin == pytest.approx(1 - rest_pressures()[1] / 200, rel=1e-6)


def test_an_ended_campaign_goes_on_and_repeats_nothing(plan, tmp_path):
    whole, halved = Store(tmp_path / "whole", {}), Store(tmp_path / "halved", {})
    execute(plan, whole, perform_here)
    done = []

    def interrupted(specs):
        for number, result in enumerate(counted(done)(specs)):
            if number == 3:
                raise KeyboardInterrupt
            yield result

    with pytest.raises(KeyboardInterrupt):
        execute(plan, halved, interrupted)
    assert collect(plan, halved).missing == RUNS - 3
    del done[3:]  # what was under way is lost, and done again
    execute(plan, halved, counted(done))
    assert sorted(done) == sorted(spec.key for spec in plan)
    assert collect(plan, halved).digest == collect(plan, whole).digest


def test_shards_in_any_order_merge_to_the_same(plan, tmp_path):
    whole, parts = Store(tmp_path / "whole", {}), Store(tmp_path / "parts", {})
    execute(plan, whole, lambda specs: perform_here(reversed(list(specs))))
    for number in (3, 1, 2):
        part = Store(tmp_path / "parts" / str(number), {})
        execute(plan, part, perform_here, Shard(number, 3))
    assert collect(plan, parts).digest == collect(plan, whole).digest


def test_a_key_knows_what_counts_and_not_where_files_lie(plan, tmp_path):
    keys = [spec.key for spec in plan]
    assert len(set(keys)) == RUNS
    other = tmp_path / "elsewhere"
    other.mkdir()
    same = Plan(replace(read_campaign(write_rest(other)), runs=RUNS))
    assert [spec.key for spec in same] == keys
    for changed in (REST.replace("200 bar", "201 bar"), REST.replace("0.01\n", "0.02\n", 1)):
        path = write_rest(other, changed)
        found = Plan(replace(read_campaign(path), runs=RUNS))
        assert not {spec.key for spec in found} & {*keys}
    (other / "bench.toml").write_text("[bench]\ntick_us = 500\n")
    path = write_rest(other, 'bench = "bench.toml"\n' + REST)
    found = Plan(replace(read_campaign(path), runs=RUNS))
    assert not {spec.key for spec in found} & {*keys}


@pytest.mark.long  # two processes import the whole package
def test_two_processes_find_what_one_does(plan, tmp_path):
    here, there = Store(tmp_path / "here", {}), Store(tmp_path / "there", {})
    execute(plan, here, perform_here)
    with run_pool(2) as pool:
        execute(plan, there, pool)
    assert collect(plan, there).digest == collect(plan, here).digest


def runs(process):
    """Return whether a process runs; one whose parent has died may stay as a zombie."""
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state not in {"Z", "X"}


FIRMWARE = """\
import os, pathlib, signal, sys, time
what, folder = sys.argv[1:]
pathlib.Path(folder, what + ".pid").write_text(str(os.getpid()))
if what == "ends":
    sys.exit(3)
if what == "kills":
    os.kill(os.getppid(), signal.SIGKILL)
time.sleep(600)
"""


@pytest.mark.long  # so do four, one after the other
def test_firmware_that_hangs_ends_or_kills_is_a_result(tmp_path, make_file):
    program = make_file("firmware.py", FIRMWARE)
    head = '[controller]\nfirmware = ["true"]\n'
    write_rest(tmp_path, REST.replace("[parameters]", f"{head}[parameters]", 1))
    words = {
        name: [sys.executable, str(program), name, str(tmp_path)]
        for name in ("hangs", "ends", "kills")
    }
    campaign = tmp_path / "campaign.toml"
    lines = [f"{name} = {value}" for name, value in words.items()]
    head = 'scenarios = ["rest.scenario.toml"]\nruns = 1\ntimeout_s = 4.0\n'
    campaign.write_text("\n".join([f"{head}[firmware]", *lines]) + "\n")
    plan = Plan(read_campaign(campaign))
    store = Store(tmp_path / "out", plan.firmware)
    with run_pool(1) as pool:
        execute(plan, store, pool)
    found = {each.firmware: each for each in collect(plan, store).results}
    assert {name: each.outcome for name, each in found.items()} == {
        "hangs": "timed out",
        "ends": "crashed",
        "kills": "crashed",
    }
    assert found["hangs"].problem == "has taken more than 4 s"
    assert "exit code 3" in found["ends"].problem
    assert "SIGKILL" in found["kills"].problem
    for name in words:
        assert not runs(int((tmp_path / f"{name}.pid").read_text()))


def test_results_of_another_program_or_firmware_are_refused(plan, tmp_path, monkeypatch):
    old = Store(tmp_path / "out", {"new": "a" * 32})
    execute(plan, old, perform_here)
    with pytest.raises(ConfigError, match=r"another build of the firmware 'new' \(aaaaaaaa\)"):
        collect(plan, Store(tmp_path / "out", {"new": "b" * 32}))
    monkeypatch.setattr("hil_bench.abilities.campaign.store.program_identity", lambda: "9.9+0")
    with pytest.raises(ConfigError, match=r"comes from hil-bench 0.*, and this is 9\.9"):
        collect(plan, old)


def test_a_bench_that_changes_under_a_campaign_is_refused(tmp_path):
    (tmp_path / "bench.toml").write_text("[bench]\ntick_us = 1000\n")
    path = write_rest(tmp_path, 'bench = "bench.toml"\n' + REST)
    (spec, *_) = Plan(replace(read_campaign(path), runs=1))
    (tmp_path / "bench.toml").write_text("[bench]\ntick_us = 500\n")
    with pytest.raises(ConfigError, match="is not that of the campaign"):
        next(perform_here([spec]))


def test_a_full_disk_is_said_once_and_earlier_runs_are_kept(plan, tmp_path, monkeypatch):
    # However slow the machine is, no time passes that would begin another file.
    monkeypatch.setattr("hil_bench.abilities.campaign.table.monotonic", lambda: 0.0)
    store = Store(tmp_path / "out", {})
    execute(plan, store, perform_here, Shard(1, 2))

    def full(_descriptor):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("hil_bench.abilities.campaign.store.os.fsync", full)
        with pytest.raises(ConfigError, match="No space left on device; all earlier runs are kept"):
            execute(plan, store, perform_here)
    assert [path.suffix for path in (tmp_path / "out").iterdir()] == [".parquet"]
    assert collect(plan, store).missing == RUNS // 2


def test_a_broken_file_of_results_is_named(tmp_path):
    store = Store(tmp_path / "out", {})
    path = tmp_path / "out" / "x.parquet"
    path.write_bytes(b"PAR1 cut off")
    with pytest.raises(ConfigError, match=r"x\.parquet: cannot be read: .*; remove it"):
        store.keys()
    pq.write_table(pa.table({"zzzz": [1]}), path, store_schema=False)
    path.write_bytes(path.read_bytes().replace(b"zzzz", b"\xff\xfe\xff\xfe"))  # no UTF-8
    with pytest.raises(ConfigError, match=r"x\.parquet: cannot be read: .*; remove it"):
        store.keys()


def test_no_thread_of_arrow_needs_the_interpreter(plan, tmp_path, monkeypatch):
    # A thread of Arrow's that runs Python, or releases a buffer of Python's, as the interpreter
    # ends calls std::terminate: "terminate called without an active exception", exit code 134.
    store = Store(tmp_path / "out", {})
    store.write([failed_run(spec, RunOutcome.CRASHED, "") for spec in plan])
    sources = []
    opened = pq.ParquetFile
    monkeypatch.setattr(pq, "ParquetFile", lambda file: sources.append(file) or opened(file))
    assert len(store.keys()) == len(list(store.results())) == RUNS
    assert [type(each) for each in sources] == [pa.OSFile, pa.OSFile]


def test_two_results_of_one_run_that_differ_are_said(plan, tmp_path):
    store = Store(tmp_path / "out", {})
    results = list(perform_here(plan))
    store.write(results)
    store.write([results[0]._replace(duration=9.0)])
    with pytest.raises(ConfigError, match="was done twice, and the results differ"):
        collect(plan, store)


def test_tolerances_change_the_bench(tmp_path, make_file):
    write_rest(tmp_path)
    campaign = make_file(
        "campaign.toml",
        'scenarios = ["rest.scenario.toml"]\nsampler = "grid"\nlevels = 1\n'
        "[parameters]\nlimit_bar = { values = [100.0] }\n"
        '[tolerances]\n"plant.axis1.supply_pressure_bar" = { values = [80.0, 100.0] }\n',
    )
    plan = Plan(read_campaign(campaign))
    assert len({spec.key for spec in plan}) == 2
    margins = [each.verdicts[0].margin for each in perform_here(plan)]
    # The pressures at rest are shares of the supply pressure; the tank is at 0 bar.
    at_rest = rest_pressures()[0] / 100.0
    assert margins == pytest.approx([1 - 0.8 * at_rest, 1 - at_rest], rel=1e-6)


def test_a_campaign_plays_with_a_controller_of_ours(tmp_path):
    head = '[controller]\nexample = "position_control"\n'
    path = write_rest(tmp_path, REST.replace("[parameters]", f"{head}[parameters]", 1))
    results = perform_here(Plan(replace(read_campaign(path), runs=2)))
    assert [each.outcome for each in results] == ["passed"] * 2


def test_the_table_has_a_row_a_run(tmp_path):
    path = write_rest(tmp_path)
    table = hil_bench.run_campaign(path, runs=5, sampler="grid", output=tmp_path / "out")
    assert len(table) == 25  # five levels of two parameters
    expected = [margin_of(each) for each in table["limit_bar"]]
    assert list(table["R-1 margin"]) == pytest.approx(expected, rel=1e-6)
    assert set(table.loc[table["R-1 margin"] < 0, "R-1"]) == {"failed"}


def test_sources_decide_the_identity_of_the_program():
    assert store.program_identity().startswith(f"{hil_bench.__version__}+")


def test_the_identity_of_the_program_has_its_tables_of_parameters(monkeypatch):
    read = []

    def read_bytes(path, original=Path.read_bytes):
        read.append(path.name)
        return original(path)

    monkeypatch.setattr(Path, "read_bytes", read_bytes)
    store.program_identity.cache_clear()
    store.program_identity()

    assert {"parameters.tsv", "chain.tsv", "parameters.py"} <= set(read)


@pytest.mark.long
def test_the_command_line_runs_repeats_and_compares(tmp_path, capsys, cli):
    close = REST.replace(
        "value = 250.0, range = [1.0, 301.0]", "value = 60.0, range = [20.0, 80.0]"
    )
    path = write_rest(tmp_path, close)
    words = ["campaign", str(path), "--runs=4", "--jobs=0"]
    lines = cli(words, 1).out.splitlines()
    assert lines[0].startswith("4 runs: ")
    repeat = next(line for line in lines if "repeat it: " in line).partition("repeat it: ")[2]
    assert main(repeat.split()[1:]) == 1
    capsys.readouterr()
    (key,) = [spec.key for spec in Plan(replace(read_campaign(path), runs=1))]
    assert main([*words, "--run", key[:8]]) in {0, 1}
    other = tmp_path / "other"
    other.mkdir()
    eased = write_rest(other, close.replace("200 bar", "40 bar"))
    again = ["campaign", str(eased), "--runs=4", "--jobs=0"]
    capsys.readouterr()
    out = cli([*again, "--compare", str(tmp_path / "rest.results")], 1).out
    assert "R-2: of 4 common runs 4 newly failed, 0 no longer" in out


@pytest.mark.parametrize("key", ["runs", "levels", "seed", "timeout"])
def test_a_default_is_that_of_the_document(tmp_path, make_file, key):
    path = make_file("c.toml", 'scenarios = ["rest.scenario.toml"]\n')
    write_rest(tmp_path)
    document = Path(__file__).parents[3] / "docs" / "campaigns.md"
    rows = [row.split("|")[1:3] for row in document.read_text().splitlines() if "`" in row]
    said = {row[0].strip(): row[1].strip() for row in rows if len(row) == 2}
    name = "timeout_s" if key == "timeout" else key
    assert getattr(read_campaign(path), key) == float(said[f"`{name}`"])


def test_a_table_says_how_little_a_run_has_seen():
    runs = [
        run_result(Verdict("R-1", "inconclusive", None, "", seen)) for seen in (1.0, 0.25, None)
    ]
    assert to_table(runs)["R-1 seen"].to_list()[:2] == [1.0, 0.25]
    (found,) = summarise(runs[::2])
    assert (found.seen, "seen" in found.line()) == (1.0, False)


@pytest.mark.long
def test_a_script_without_a_guard_is_said_at_once(tmp_path):
    path = write_rest(tmp_path)
    program = tmp_path / "script.py"
    program.write_text(f"import hil_bench\nhil_bench.run_campaign({str(path)!r}, runs=2, jobs=1)\n")
    words = [sys.executable, str(program)]
    ended = subprocess.run(words, capture_output=True, text=True, check=False)  # noqa: S603
    last = ended.stderr.strip().splitlines()[-1]
    assert last.endswith('a script needs `if __name__ == "__main__":`; jobs=0 needs no process')
