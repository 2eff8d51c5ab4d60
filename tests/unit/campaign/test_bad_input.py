"""Bad input of campaigns: one line each, exit code 2, nothing is run."""

import errno
import json
import threading

import pyarrow.parquet as pq
import pytest
from support.campaigns import REST, write_rest
from support.tables import from_text

from hil_bench import ConfigError
from hil_bench.abilities.campaign import snapshot
from hil_bench.abilities.campaign.plan import Plan
from hil_bench.abilities.campaign.records import RunOutcome, RunResult, read_campaign
from hil_bench.abilities.campaign.store import Store
from hil_bench.abilities.common import progress
from hil_bench.abilities.common.progress import WorkLines
from hil_bench.cli import main

PLAIN = REST.replace(", range = [1.0, 301.0]", "").replace(", range = [-1.0, 1.0]", "")


@pytest.mark.parametrize(("limit", "code"), [(300.0, 5), (1.0, 1)])
def test_a_run_that_failed_stays_exit_code_1_on_a_full_disk(limit, code, tmp_path, monkeypatch):
    def full(_descriptor):
        raise OSError(errno.ENOSPC, "No space left on device")

    path = write_rest(tmp_path, REST)
    words = ["campaign", str(path), "--jobs", "0", "--runs", "2", "--set", f"limit_bar={limit}"]
    monkeypatch.setattr("hil_bench.abilities.campaign.store.os.fsync", full)
    assert main([*words, "--output", str(tmp_path / "out")]) == code


def test_results_that_are_not_there_are_not_merged(tmp_path, capsys):
    path = write_rest(tmp_path, REST)
    folder = tmp_path / "typo"
    assert main(["campaign", str(path), "--merge", "--output", str(folder)]) == 2
    assert f"--merge: there is no folder {folder}" in capsys.readouterr().err
    assert not folder.exists()


@from_text("campaign", "scenario", "wrong")
def test_a_bad_campaign_is_one_line(campaign, scenario, wrong, tmp_path, make_file, cli):
    write_rest(tmp_path, scenario or REST)
    path = make_file("campaign.toml", campaign + "\n")
    errors = cli(["campaign", str(path), "--jobs=0"], 2).err.splitlines()
    assert len(errors) == 1
    assert wrong in errors[0]
    assert {each.name for each in tmp_path.iterdir()} == {"campaign.toml", "rest.scenario.toml"}


@pytest.mark.parametrize("shard", ["0/2", "3/2", "1", "a/b", "-1/2"])
def test_a_part_that_is_none_is_refused(shard, tmp_path, cli):
    path = write_rest(tmp_path)
    assert "give I/N, as in 3/16" in cli(["campaign", str(path), f"--shard={shard}"], 2).err


def test_a_bench_that_stores_parameters_in_files_is_refused(tmp_path, cli):
    (tmp_path / "bench.toml").write_text(
        '[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\nstorage = "kept"\n'
    )
    path = write_rest(tmp_path, 'bench = "bench.toml"\n' + REST)
    assert "carries them from run to run" in cli(["campaign", str(path)], 2).err


def test_a_requirement_that_is_never_exercised_is_said(tmp_path, cli):
    never = 'that = "whenever axis1.P_B > 500 bar then axis1.P_A < 1 bar"'
    text = REST.replace('that = "always axis1.P_B < 200 bar"', never)
    path = write_rest(tmp_path, text.replace("range = [1.0, 301.0]", "range = [200.0, 301.0]"))
    out = cli(["campaign", str(path), "--runs=2", "--jobs=0"], 6).out
    assert "R-2: 2 not exercised; no run was decided, so nothing is known of it" in out


def test_a_requirement_that_is_named_and_not_judged_is_undecided(tmp_path, cli):
    text = REST.replace("range = [1.0, 301.0]", "range = [200.0, 301.0]")  # all runs pass
    path = write_rest(tmp_path, 'requirement_ids = ["R-1", "R-9"]\n' + text)
    report = tmp_path / "report.html"
    words = ["campaign", str(path), "--runs=2", "--jobs=0"]
    out = cli([*words, f"--report={report}"], 6).out
    said = "rest  R-9: not judged; requirement_ids names it, and no expectation has this id"
    assert out.startswith("2 runs: 2 passed\n")
    assert f"  {said}\n" in out
    assert said in report.read_text(encoding="utf-8")
    assert json.loads(cli([*words, "--json"], 6).out)["unjudged"] == [said]


def test_a_bound_counts_decided_runs_alone(tmp_path, capsys, cli):
    # R-2 is open at the last ticks of every run; R-1 holds in all of them.
    text = REST.replace("always axis1.P_B < 200 bar", "always (axis1.P_B < 200 bar for 5 ms)")
    path = write_rest(tmp_path, text.replace("range = [1.0, 301.0]", "range = [200.0, 301.0]"))
    words = ["campaign", str(path), "--runs=3", "--jobs=0", "--sampler=monte_carlo"]
    out = cli(words, 6).out
    undecided = "no failure in 0 decided runs of 3 (3 inconclusive); so there is no bound"
    assert f"  rest: {undecided}" in out
    assert f"  rest  R-2: {undecided}" in out
    # 1 - 0.05^(1/3) = 0.632
    bound = "95% upper bound on the failure probability under the sampled distribution 0.63"
    assert f"  rest  R-1: no failure in 3 runs; {bound}" in out
    for shard in ("1/2", "2/2"):
        main([*words, f"--shard={shard}", "--output", str(tmp_path / "all" / shard[0])])
    capsys.readouterr()
    assert main([*words, "--merge", "--json", "--output", str(tmp_path / "all")]) == 6
    bounds = json.loads(capsys.readouterr().out)["bounds"]
    assert bounds == [line.strip() for line in out.splitlines() if "no failure" in line]


@pytest.mark.parametrize("word", ["nothing=1", "limit_bar", "limit_bar=nan", "limit=60"])
def test_a_wrong_set_is_said_as_test_says_it(word, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    path = write_rest(tmp_path)
    said = set()
    for verb in ("test", "campaign", "falsify"):
        assert main([verb, str(path), "--set", word]) == 2
        said.add(capsys.readouterr().err)
    assert len(said) == 1


def test_a_set_parameter_is_part_of_a_campaign(tmp_path, capsys, cli):
    path = write_rest(tmp_path)
    # P_A is 48 bar at rest: all runs fail, whatever the load is.
    words = ["campaign", str(path), "--runs=2", "--jobs=0"]
    out = cli([*words, "--set", "limit_bar=30"], 1).out
    assert "R-1: 2 failed" in out
    repeat = next(line for line in out.splitlines() if "repeat it: " in line).partition("it: ")[2]
    assert "--set=limit_bar=30.0 --set=load_n=" in repeat
    assert main(repeat.split()[1:]) == 1
    capsys.readouterr()
    found = json.loads(cli([*words, "--set", "limit_bar=30", "--merge", "--json"], 1).out)
    assert found["set"] == {"limit_bar": 30.0}
    margins = [each["margin"] for run in found["worst"] for each in run["verdicts"][:1]]
    assert found["requirements"][0]["smallest_margin"] == min(margins) < max(margins)
    for other in (["--set", "limit_bar=31"], []):
        assert main([*words, *other]) == 2
        wrong = "comes from a campaign with --set=limit_bar=30.0, and this has"
        assert wrong in capsys.readouterr().err


def test_a_search_leaves_a_set_parameter_alone(tmp_path, cli, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["falsify", str(write_rest(tmp_path)), "--runs=2", "--jobs=0", "--method=random"]
    found = json.loads(cli([*words, "--set=limit_bar=30", "--json"], 1).out)
    assert found["set"] == {"limit_bar": 30.0}
    assert {*found["requirements"][0]["at"]} == {"load_n"}
    (failure,) = found["failures"]
    assert failure["shrunk"]["parameters"] == [{"name": "limit_bar", "value": 30.0, "span": None}]


def test_campaigns_without_a_run_in_common_cannot_be_compared(tmp_path, capsys):
    path = write_rest(tmp_path)
    words = ["campaign", str(path), "--runs=1", "--jobs=0"]
    main([*words, "--seed=1"])
    before = (tmp_path / "rest.results").rename(tmp_path / "before")
    capsys.readouterr()
    assert main([*words, "--seed=2", "--compare", str(before)]) == 2
    assert "no run is in both campaigns" in capsys.readouterr().err


def test_a_parameter_that_does_nothing_is_said_without_a_controller(tmp_path, capsys):
    path = write_rest(tmp_path, REST.replace('"load_n"', "0.0"))
    assert main(["campaign", str(path), "--jobs=0"]) == 2
    assert "parameters.load_n: does nothing; name it in a step" in capsys.readouterr().err


@pytest.mark.parametrize("verb", ["campaign", "falsify"])
def test_a_log_says_how_far_the_runs_are(verb, tmp_path, monkeypatch, cli):
    looked = threading.Event()
    own_look, own_perform = WorkLines.look, snapshot.perform

    def look(self):
        own_look(self)
        looked.set()

    def perform(spec):
        assert looked.wait(60.0)  # for the other thread, which never waits as long
        return own_perform(spec)

    monkeypatch.setattr(progress, "WORK_PERIOD", 0)
    monkeypatch.setattr(progress, "_LOOK_S", 0.01)
    monkeypatch.setattr(WorkLines, "look", look)
    monkeypatch.setattr(snapshot, "perform", perform)
    monkeypatch.chdir(tmp_path)
    path = write_rest(tmp_path, REST.replace("range = [1.0, 301.0]", "range = [60.0, 301.0]"))
    total = {"campaign": 1, "falsify": 3}[verb]
    said = cli([verb, str(path), "--runs=1", "--jobs=0", "--json"])
    assert f"hil-bench: {verb}: 0 of {total} runs, 0 s\n" in said.err
    json.loads(said.out)


@pytest.mark.parametrize(
    "change",
    [
        lambda table: table.drop_columns(["verdicts"]),
        lambda table: table.take([0] * 100_001),
        lambda table: table.rename_columns([f"{name}x" for name in table.column_names]),
        lambda table: table.set_column(
            table.column_names.index("outcome"), "outcome", [["perhaps"] * len(table)]
        ),
    ],
)
def test_a_table_with_other_rows_is_an_error_of_one_line(tmp_path, change):
    """Of the kind of file that another program, or a disk, may leave in the folder."""
    store = Store(tmp_path, {})
    store.write([RunResult("k", "s", "b", "", 1, {"a": 1.0}, RunOutcome.PASSED)])
    (path,) = tmp_path.glob("*.parquet")
    pq.write_table(change(pq.read_table(path)), path)
    with pytest.raises(ConfigError, match=r"\.parquet: has (a row|100001 rows).* result"):
        list(store.results(is_foreign=True))


def test_where_nothing_varies_each_run_has_a_seed_of_its_own(tmp_path, cli):
    write_rest(tmp_path, PLAIN)
    path = tmp_path / "campaign.toml"
    path.write_text('scenarios = ["rest.scenario.toml"]\nseeds = "each"\nruns = 3\n')
    assert [spec.seed for spec in Plan(read_campaign(path))] == [0, 1, 2]
    assert "3 passed" in cli(["campaign", str(path), "--jobs=0"]).out
