import argparse
import io
import json
from pathlib import Path

import pytest
from support.tables import from_text

from hil_bench.abilities.commissioning import comparison
from hil_bench.abilities.commissioning.comparison import Difference, Mend, Write
from hil_bench.abilities.commissioning.verbs import bus_check
from hil_bench.abilities.commissioning.verbs.bus_check import _assignment
from hil_bench.abilities.common.terminal import CLEARANCE, agrees
from hil_bench.bench.configuration import load_config
from hil_bench.cli import main

EXAMPLES = Path(__file__).parents[3] / "examples"


def test_the_virtual_bench_is_as_its_configuration_says(cli):
    assert "as the configuration says" in cli("check --bus --virtual").err


@pytest.fixture
def one_difference(monkeypatch):
    """The heartbeat of node 1 is wrong until it was written."""
    differences = [
        [Difference(1, "node 1: 0x1017.00 is 0; 50 is right", Mend.WRITE, (0x1017, 0), 50)],
        [],
    ]

    def compare(network, config):
        for node in config.nodes:
            network.add_node(node.node_id, node.eds)
        network.pump(0.01)
        return differences.pop(0)

    monkeypatch.setattr(comparison, "compare", compare)
    return differences


@pytest.mark.parametrize(("silent", "code"), [(4, 6), (3, 1)])
def test_a_bus_on_which_nobody_answers_is_inconclusive(silent, code, monkeypatch):
    missing = [comparison._missing(node) for node in load_config().nodes[:silent]]
    monkeypatch.setattr(comparison, "compare", lambda _network, _config: missing)
    assert main(["check", "--bus", "--virtual"]) == code


@pytest.mark.usefixtures("one_difference")
def test_a_difference_comes_with_the_command_that_mends_it(cli):
    assert cli("check --bus --virtual", 1).out == (
        "node 1: 0x1017.00 is 0; 50 is right; "
        "mend: hil-bench check --bus --virtual --apply --node 1\n"
    )


def test_the_command_names_the_bus_and_the_file():
    args = argparse.Namespace(
        config="my bench.toml",
        virtual=False,
        on=None,
        interface="socketcand",
        channel="can0",
        bus_kwargs={"host": "127.0.0.1", "port": 29536},
    )
    assert bus_check._mending(Difference(3, "", Mend.WRITE), args) == (
        "mend: hil-bench check 'my bench.toml' --bus -i socketcand -c can0 "
        "--bus-kwargs host=127.0.0.1 port=29536 --apply --node 3"
    )


@pytest.mark.usefixtures("one_difference")
def test_json_is_for_programs(cli):
    (difference,) = json.loads(cli("check --bus --virtual --json", 1).out)
    assert (difference["object"], difference["right"]) == ("0x1017.00", 50)


@pytest.mark.usefixtures("one_difference")
def test_what_is_applied_is_shown_first(cli):
    out, err = cli("check --bus --virtual --apply --yes")
    assert err.endswith("\nthe bus is as the configuration says\n")
    assert "  0x1017.00 = 50 (0x0032)  Producer heartbeat time" in out
    assert "left in PRE-OPERATIONAL, until an NMT start: node 1\n" in err


@pytest.mark.usefixtures("one_difference")
def test_quiet_leaves_the_verdict_to_the_exit_code(cli):
    assert "as the configuration" not in cli("check --bus --virtual --apply --yes -q").err


@pytest.mark.usefixtures("one_difference")
def test_an_interruption_says_what_is_half_done(cli, monkeypatch):
    def interrupt(*_arguments, **_options):
        raise KeyboardInterrupt

    monkeypatch.setattr(comparison, "apply", interrupt)
    assert cli("check --bus --virtual --apply --yes", 130).err.endswith(
        "interrupted; node 1 is half configured and in PRE-OPERATIONAL: the same command again "
        "completes it\n"
    )


@pytest.mark.usefixtures("one_difference")
def test_nothing_is_written_to_other_nodes(cli):
    assert "0x0032" not in cli("check --bus --virtual --apply --yes --node 2", 1).out


@pytest.mark.usefixtures("one_difference")
def test_without_anybody_to_ask_nothing_is_written(cli, monkeypatch):
    monkeypatch.setattr("sys.stdin.isatty", lambda: False)
    assert "give --yes to write without asking" in cli("check --bus --virtual --apply", 2).err


@pytest.mark.parametrize("answer", ["", "n", "no", "yess"])
def test_anything_but_yes_writes_nothing(answer, one_difference, monkeypatch):
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr("builtins.input", lambda _: answer)
    assert main(["check", "--bus", "--virtual", "--apply"]) == 1
    assert len(one_difference) == 1  # nothing was written, so nothing was compared again


def test_an_input_that_ends_is_no_yes(one_difference, monkeypatch):
    """Ctrl-D, which was "a bug of hil-bench": before a motion, too."""
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    assert main(["check", "--bus", "--virtual", "--apply"]) == 1
    assert len(one_difference) == 1


def test_an_input_that_ends_moves_nothing(capsys, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    assert not agrees(CLEARANCE, "yes")
    assert "Type yes to move: \n" in capsys.readouterr().out


def test_the_concise_dcf_is_a_file_a_node(one_difference, tmp_path):
    assert one_difference
    assert main(["check", "--bus", "--virtual", "--dcf", str(tmp_path / "dcf")]) == 1
    # One entry; 0x1017.00, 2 bytes, 50 (CiA 302-3).
    expected = bytes.fromhex("01000000 1710 00 02000000 3200")
    assert (tmp_path / "dcf" / "node1.cdcf").read_bytes() == expected


@pytest.mark.usefixtures("one_difference")
def test_a_folder_that_cannot_be_written_is_exit_code_2(tmp_path, capsys):
    (tmp_path / "file").touch()
    assert main(["check", "--bus", "--virtual", "--dcf", str(tmp_path / "file")]) == 2
    assert "cannot be written" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--apply"], "--apply: belongs to --bus"),
        (["--virtual"], "--virtual: belongs to --bus"),
        (["--bus", "--virtual", "--yes"], "--yes: belongs to --apply"),
    ],
)
def test_options_that_need_others_say_so(arguments, message, cli):
    assert message in cli(["check", *arguments], 2).err


def test_a_write_is_shown_as_an_engineer_reads_it():
    expected = {
        Write((0x1800, 5), "", 20, b"\x14\x00"): "0x1800.05 = 20 (0x0014)",
        Write((0x1800, 1), "", 0x40000182, b"\x82\x01\x00\x40"): "0x1800.01 = 0x40000182",
        Write((0x6148, 1), "", 1.5, b"\x00\x00\xc0\x3f"): "0x6148.01 = 1.5 (0x3FC00000)",
    }
    assert {write: _assignment(write) for write in expected} == expected


def test_one_of_several_buses_is_checked_by_its_name(cli):
    bench = str(EXAMPLES / "two_buses.toml")
    assert main(["check", bench, "--bus", "--virtual", "--on", "sensors"]) == 0
    assert cli(["check", bench, "--bus", "--virtual"]).err.count("as the configuration says") == 2
    found = json.loads(cli(["scan", bench, "--virtual", "--on", "sensors", "--json"]).out)["nodes"]
    assert [(node["node_id"], node["profile"][:7]) for node in found] == [
        (1, "CiA 404"),
        (2, "CiA 404"),
        (3, "CiA 406"),
    ]


@from_text("arguments", "message")
def test_a_bus_that_cannot_be_meant_is_told(capsys, arguments, message):
    bench = str(EXAMPLES / "two_buses.toml")
    assert main([word.replace("BENCH", bench) for word in arguments.split()]) == 2
    assert capsys.readouterr().err == f"hil-bench: error: {message.replace('BENCH', bench)}\n"


def test_a_twin_listens_to_one_bus(capsys):
    bench = str(EXAMPLES / "two_buses.toml")
    assert main(["shadow", bench]) == 2
    assert capsys.readouterr().err.endswith("give shadow a bench.toml with all nodes on one\n")
