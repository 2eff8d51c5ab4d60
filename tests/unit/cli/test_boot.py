"""`hil-bench boot` on the virtual bench."""

import json
from pathlib import Path

import pytest

from hil_bench.cli import main
from hil_drivers import Network

EXAMPLES = Path(__file__).parents[3] / "examples"
NETWORK = str(EXAMPLES / "network.toml")


def test_the_built_in_bench_is_booted_as_it_is(cli):
    out = cli("boot --virtual").out.splitlines()
    assert out[0] == "bus      virtual bench"
    assert out[1] == "node 1 (valve): booted, nothing to configure"
    assert out[-1] == "network  started, 4 slaves"


def test_a_network_is_booted_and_kept_up(capsys):
    assert main(["boot", "--virtual", "--network", NETWORK, "--stay", "1"]) == 0
    assert "node 1 (valve): booted, 5 objects written\n" in capsys.readouterr().out


@pytest.mark.parametrize(("stay", "code"), [("inf", 0), ("1", 130)])
def test_ctrl_c_ends_a_watch_without_an_end_and_breaks_off_another(capsys, monkeypatch, stay, code):
    def press(_manager, duration):
        assert duration == float(stay)
        raise KeyboardInterrupt

    monkeypatch.setattr("hil_bench.abilities.commissioning.verbs.boot.NetworkManager.watch", press)
    assert main(["boot", "--virtual", "--stay", stay]) == code
    said = "ended by Ctrl-C; the slaves stay as they are\n" in capsys.readouterr().err
    assert said is (stay == "inf")


def test_a_missing_mandatory_slave_is_exit_code_1(cli, tmp_path):
    path = tmp_path / "network.toml"
    path.write_text(
        "[master]\nboot_time_s = 1\n[slaves.a]\nnode_id = 1\n[slaves.gone]\nnode_id = 9\n",
        encoding="utf-8",
    )
    assert cli(["boot", "--virtual", "--network", str(path)], 1).out.splitlines()[-1] == (
        "network  not started: mandatory node 9 (gone) (B)"
    )
    found = json.loads(cli(["boot", "--virtual", "--network", str(path), "--json"], 1).out)
    assert found["started"] is False
    assert found["slaves"][1]["error"] == "B"


def test_a_missing_optional_slave_is_named(capsys, tmp_path):
    path = tmp_path / "network.toml"
    path.write_text(
        "[slaves.a]\nnode_id = 1\n[slaves.gone]\nnode_id = 9\nmandatory = false\n", encoding="utf-8"
    )
    assert main(["boot", "--virtual", "--network", str(path)]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "network  started without node 9 (gone) (B)"


def test_quiet_prints_nothing(cli):
    assert cli("boot --virtual -q") == ("", "")


def test_concise_dcfs_are_files_a_slave(tmp_path):
    assert main(["boot", "--network", NETWORK, "--concise-dcf", str(tmp_path / "c")]) == 0
    assert [path.name for path in (tmp_path / "c").iterdir()] == ["valve.cdcf"]
    # CiA 302-3: the number of entries comes first.
    assert (tmp_path / "c" / "valve.cdcf").read_bytes()[:4] == b"\5\0\0\0"


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (["--concise-dcf", "x"], "--concise-dcf: needs the configurations of a network"),
        (["--stay", "-1"], "give a positive number of seconds, or inf"),
        (["--network", "none.toml"], "none.toml: cannot be read"),
    ],
)
def test_wrong_arguments_are_a_line(cli, arguments, what):
    (line,) = cli(["boot", "--virtual", *arguments], 2).err.splitlines()
    assert what in line


def test_a_mandatory_slave_that_is_not_operational_is_exit_code_1(cli, monkeypatch):
    start = Network.start_node

    def start_node(network, node_id=0):
        start(network, node_id)
        network.enter_pre_operational(1)

    monkeypatch.setattr(Network, "start_node", start_node)
    assert cli("boot --virtual", 1).out.splitlines()[-2:] == [
        "node 1 (valve): PRE-OPERATIONAL after its start",
        "network  not started: mandatory node 1 (valve) is PRE-OPERATIONAL",
    ]


def test_slaves_that_report_no_state_are_exit_code_6(cli, monkeypatch):
    monkeypatch.setattr(Network, "request", lambda _network, _cob_id, _length: None)
    line = cli("boot --virtual", 6).out.splitlines()[-1]
    assert line.startswith("network  start commanded, 4 slaves; no state from node 1 (valve)")


def test_slaves_that_nobody_starts_are_not_started(cli, make_file):
    path = make_file("network.toml", '[master]\nstart = "none"\n[slaves.a]\nnode_id = 1\n')
    assert cli(["boot", "--virtual", "--network", str(path)]).out.splitlines()[-1] == (
        "network  booted, 1 slaves; the application starts it"
    )
