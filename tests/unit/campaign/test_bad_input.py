"""Bad input of campaigns: one line each, exit code 2, nothing is run."""

import pyarrow.parquet as pq
import pytest
from support.campaigns import REST, write_rest

from hil_bench import cli
from hil_bench.campaign.records import RunOutcome, RunResult
from hil_bench.campaign.store import Store
from hil_bench.errors import ConfigError

ONE = 'scenarios = ["rest.scenario.toml"]\n'
PLAIN = REST.replace(", range = [1.0, 301.0]", "").replace(", range = [-1.0, 1.0]", "")


@pytest.mark.parametrize(
    ("campaign", "scenario", "wrong"),
    [
        ("", REST, "campaign.toml: scenarios: missing; give for example"),
        ("scenarios = []", REST, "campaign.toml:1:13: scenarios: is empty"),
        ('scenarios = ["no.scenario.toml"]', REST, "no.scenario.toml: cannot be read"),
        ('scenarios = ["rest.scenario.toml"]', PLAIN, "no parameter has a range; give one, as in"),
        ('scenarios = ["rest.scenario.toml"]\nrun = 3', REST, "campaign.toml:2:7: run: unknown"),
        ('scenarios = ["rest.scenario.toml"]\nruns = 0', REST, "runs: 0 is out of range"),
        ('scenarios = ["rest.scenario.toml"]\nseeds = 3', REST, "seeds: 3 is no list of seeds"),
        (
            'scenarios = ["rest.scenario.toml"]\n[parameters]\nlimit = { range = [1, 2] }',
            REST,
            '"limit" is no parameter of the scenarios; the nearest is limit_bar',
        ),
        (
            'scenarios = ["rest.scenario.toml"]\n[parameters]\nlimit_bar = { range = [0, 2] }',
            REST,
            "parameters.limit_bar: 0 to 2 leaves the range 1 to 301",
        ),
        (
            'scenarios = ["rest.scenario.toml"]\n[parameters]\nlimit_bar = 3',
            REST,
            "campaign.toml:3:13: parameters.limit_bar: 3 is not a distribution",
        ),
        (
            f'{ONE}[tolerances]\n"plant.axis1.no_kg" = {{ range = [1, 2] }}',
            REST,
            "plant.axis1.no_kg: unknown key",
        ),
        (
            'scenarios = ["rest.scenario.toml"]\n[firmware]\nnew = ["nowhere"]',
            REST,
            "has no firmware, and the campaign has [firmware]",
        ),
        (
            'scenarios = ["rest.scenario.toml"]\n[firmware]\nnew = ["./nowhere"]',
            REST.replace("[parameters]", '[controller]\nfirmware = ["true"]\n[parameters]'),
            "./nowhere: is no program that can be run; build it first",
        ),
        ('scenarios = ["rest.scenario.toml"]\nbenches = ["no.toml"]', REST, "no.toml: cannot be"),
        ("[nodes.valve]", REST, "campaign.toml: is a bench; give a campaign or a scenario"),
        (PLAIN, REST, "campaign.toml: no parameter has a range"),  # a scenario of any name
    ],
)
def test_a_bad_campaign_is_one_line(campaign, scenario, wrong, tmp_path, capsys):
    write_rest(tmp_path, scenario)
    path = tmp_path / "campaign.toml"
    path.write_text(campaign + "\n")
    assert cli.main(["campaign", str(path), "--jobs=0"]) == 2
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 1
    assert wrong in errors[0]
    assert {each.name for each in tmp_path.iterdir()} == {"campaign.toml", "rest.scenario.toml"}


@pytest.mark.parametrize("shard", ["0/2", "3/2", "1", "a/b", "-1/2"])
def test_a_part_that_is_none_is_refused(shard, tmp_path, capsys):
    path = write_rest(tmp_path)
    assert cli.main(["campaign", str(path), f"--shard={shard}"]) == 2
    assert "give I/N, as in 3/16" in capsys.readouterr().err


def test_a_bench_that_stores_parameters_in_files_is_refused(tmp_path, capsys):
    (tmp_path / "bench.toml").write_text(
        '[nodes.valve]\nprofile = "valve_408"\nnode_id = 1\nstorage = "kept"\n'
    )
    path = write_rest(tmp_path, 'bench = "bench.toml"\n' + REST)
    assert cli.main(["campaign", str(path)]) == 2
    assert "carries them from run to run" in capsys.readouterr().err


def test_a_requirement_that_is_never_exercised_is_said(tmp_path, capsys):
    never = 'that = "whenever axis1.P_B > 500 bar then axis1.P_A < 1 bar"'
    text = REST.replace('that = "always axis1.P_B < 200 bar"', never)
    path = write_rest(tmp_path, text.replace("range = [1.0, 301.0]", "range = [200.0, 301.0]"))
    assert cli.main(["campaign", str(path), "--runs=2", "--jobs=0"]) == 6
    assert "R-2: 2 not exercised" in capsys.readouterr().out


def test_campaigns_without_a_run_in_common_cannot_be_compared(tmp_path, capsys):
    path = write_rest(tmp_path)
    words = ["campaign", str(path), "--runs=1", "--jobs=0"]
    cli.main([*words, "--seed=1"])
    before = (tmp_path / "rest.results").rename(tmp_path / "before")
    capsys.readouterr()
    assert cli.main([*words, "--seed=2", "--compare", str(before)]) == 2
    assert "no run is in both campaigns" in capsys.readouterr().err


def test_a_parameter_that_does_nothing_is_said_without_a_controller(tmp_path, capsys):
    path = write_rest(tmp_path, REST.replace('"load_n"', "0.0"))
    assert cli.main(["campaign", str(path), "--jobs=0"]) == 2
    assert "parameters.load_n: does nothing; name it in a step" in capsys.readouterr().err


@pytest.mark.parametrize(
    "change",
    [
        lambda table: table.drop_columns(["verdicts"]),
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
    with pytest.raises(ConfigError, match=r"\.parquet: has a row that is no result of a campaign"):
        list(store.results(is_foreign=True))
