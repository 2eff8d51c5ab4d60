import json
from dataclasses import replace
from pathlib import Path

import pytest
from support.tables import from_text

from hil_bench.abilities.commissioning.discovery import Traffic
from hil_bench.abilities.commissioning.survey import LssScan
from hil_bench.abilities.commissioning.verbs.scan import _identifier_line
from hil_bench.cli import main
from hil_bench.outside.transports.embedded import EmbeddedBus

UNCONFIGURED = """
[plant.axis1]
[nodes]
valve = { profile = "valve_408", node_id = 255, serial_number = 77 }
"""


def test_the_virtual_bench_is_scanned(cli):
    out = cli("scan --virtual").out
    header, valve, *_ = (line.split("  ") for line in out.splitlines()[3:])
    assert [cell.strip() for cell in header if cell] == [
        *("node", "NMT state", "profile", "revision", "errors", "name")
    ]
    assert [cell.strip() for cell in valve if cell] == [
        *("1", "PRE-OPERATIONAL", "CiA 408, proportional valve"),
        *("0x00010000", "0x00", "HIL bench valve"),
    ]
    assert "  type      0x00000198, CiA 408, proportional valve\n" in out  # 0x198 is 408
    assert "  versions  hardware virtual, software 1.0\n" in out
    assert out.rstrip().endswith("4 nodes found")


def test_json_has_a_record_a_node(cli):
    found = json.loads(cli("scan --virtual --json --nodes 2-3").out)
    assert [node["node_id"] for node in found["nodes"]] == [2, 3]
    assert found["nodes"][0]["profile"] == "CiA 404, measuring device"
    assert found["unconfigured"] is None


def test_a_device_without_node_id_is_found_on_request(make_file, cli):
    path = make_file("bench.toml", UNCONFIGURED)
    assert "no node-ID" in (out := cli(["scan", str(path), "--virtual", "--lss"]).out)
    assert "serial 0x0000004D" in out


def test_an_empty_bus_is_inconclusive_with_a_hint(make_file, cli):
    path = make_file("bench.toml", UNCONFIGURED)
    assert "0 nodes found: is the bus powered" in cli(["scan", str(path), "--virtual"], 6).out


def test_nobody_is_guarded_on_a_bus_without_remote_frames(monkeypatch, capsys):
    """As on a hub: no node would answer, and none would be said to be there."""
    monkeypatch.setattr(EmbeddedBus, "carries_remote", False, raising=False)
    assert main(["scan", "--virtual", "--by", "guarding"]) == 2
    assert "--by guarding: this bus has no remote frames" in capsys.readouterr().err


def test_a_bus_of_j1939_is_said_to_be_one(capsys, cli):
    """The lever and the valve driver claim their addresses, and send."""
    bench = str(Path(__file__).parents[3] / "examples" / "j1939_lever.toml")
    out = cli(["scan", bench, "--virtual"], 6).out
    assert "0 nodes found: " in out
    assert "frames with 29-bit identifiers were heard, as J1939 has them" in out
    assert main(["scan", bench, "--virtual", "--listen", "0.5"]) == 0
    assert "as J1939: PGN 60928 address claimed, from 19" in capsys.readouterr().out


def test_listening_tells_what_was_heard(cli):
    out = cli("scan --virtual --listen 0.5 -b 500000").out
    assert "heard  4 frames" in out  # the boot-up messages of the four nodes
    assert "boot-up" in out
    assert "% of 500 kbit/s" in out


@from_text("arguments", "message")
def test_a_mistake_is_one_line_and_exit_code_2(arguments, message, cli):
    assert message in cli(["scan", *arguments.split()], 2).err


def test_a_bus_that_cannot_be_opened_is_exit_code_3(cli):
    assert "nosuchbus0" in cli("scan -i socketcan -c nosuchbus0", 3).err


def test_nodes_that_are_there_twice_are_named(monkeypatch, cli):
    """Two benches with the same node-IDs: each read has two answers."""
    from hil_bench.abilities.commissioning import discovery  # noqa: PLC0415

    discover = discovery.discover
    monkeypatch.setattr(
        discovery,
        "discover",
        lambda *args, **options: [
            each._replace(answers=2 if each.node_id in {1, 4} else 1)
            for each in discover(*args, **options)
        ],
    )
    out = cli("scan --virtual", 1).out
    assert "4 nodes found; twice on the bus: 1, 4" in out
    assert out.count("twice on the bus\n") == 2
    assert out.count("more than one device answers under this node-ID") == 2
    assert out.count("more than one device answers under this node-ID") == 2
    assert "give each a node-ID of its own" in out


def test_heartbeats_that_do_not_fit_leave_a_scan_undecided(monkeypatch, cli):
    from hil_bench.abilities.commissioning.verbs import scan  # noqa: PLC0415

    survey = scan.survey

    def doubt(*args, **options):
        found = survey(*args, **options)
        nodes = [replace(each, problem="too fast" * (each.node_id == 4)) for each in found.nodes]
        return replace(found, nodes=nodes, doubtful=(4,))

    monkeypatch.setattr(scan, "survey", doubt)
    out = cli("scan --virtual", 6).out
    assert "  problem   too fast" in out
    assert "4 nodes found; perhaps twice on the bus: 4" in out


def test_a_doubt_of_lss_leaves_a_scan_undecided(monkeypatch, cli):
    """Though four nodes were found."""
    from hil_bench.abilities.commissioning.verbs import scan  # noqa: PLC0415

    survey, doubt = scan.survey, LssScan((), "a device hides others")

    def look(*args, **options):
        return replace(survey(*args, **options), unconfigured=doubt)

    monkeypatch.setattr(scan, "survey", look)
    out = cli("scan --virtual --lss", 6).out
    assert "\na device hides others\n4 nodes found\n" in out


def test_a_long_scan_says_that_it_goes_on(monkeypatch, cli):
    from hil_bench.abilities.common import progress  # noqa: PLC0415

    monkeypatch.setattr(progress, "WORK_PERIOD", 0)
    monkeypatch.setattr(progress, "_LOOK_S", 0.001)
    assert "hil-bench: scan: " in cli("scan --virtual --nodes 1-4").err


@pytest.mark.parametrize(
    ("can_id", "is_extended", "words"),
    [
        (0x0CF00400, True, ["0x0CF00400", "not", "CANopen", "5", "2.5/s"]),  # 29 bits: 8 digits
        (0x081, False, ["0x081", "EMCY", "node", "1", "5", "2.5/s"]),  # 11 bits: 3 digits
    ],
)
def test_an_identifier_has_all_its_digits(can_id, is_extended, words):
    """Five frames in two seconds."""
    line = _identifier_line(Traffic(can_id, is_extended=is_extended, frames=5), 2.0)
    assert line.split()[: len(words)] == words


def test_a_bus_in_operation_is_only_heard(monkeypatch, capsys, cli):
    """The line names what was heard, and what the scan would send."""
    from hil_bench.abilities.commissioning import discovery  # noqa: PLC0415

    monkeypatch.setattr(
        discovery, "signs_of_operation", lambda _traffic: ("node 3 is OPERATIONAL",)
    )
    arguments = ["scan", "--virtual", "--lss", "--nodes", "1-9"]
    lines = cli(arguments, 6).out.splitlines()
    assert "the bus is in operation: node 3 is OPERATIONAL" in lines
    assert "  a read of 0x1000 to each of the node-IDs 1 to 9" in lines
    assert any("LSS fastscan" in line for line in lines)
    assert main([*arguments, "--ask"]) == 0
    capsys.readouterr()
    assert json.loads(cli("scan --virtual --json", 6).out)["operation"] == ["node 3 is OPERATIONAL"]
