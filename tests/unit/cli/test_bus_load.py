"""`hil-bench bus-load`: the numbers of a small bench, by hand."""

import json
from pathlib import Path

import pytest

from hil_bench import load_config
from hil_bench.cli import main

EXAMPLES = Path(__file__).parents[3] / "examples"

BENCH = """\
[bus]
bitrate = 125_000
[nodes]
valve = { profile = "valve_408", node_id = 1 }
[nodes.position]
profile = "encoder_406"
node_id = 4
[nodes.position.objects]
"0x1800.02" = 1
"0x1017.00" = 500
"""


@pytest.fixture
def bench(make_file):
    path = make_file("bench.toml", BENCH)
    return str(path)


def found(capsys):
    content = json.loads(capsys.readouterr().out)
    return content["buses"], {row["name"]: row for row in content["messages"]}


def test_load_and_response_times_are_those_of_the_paper_by_hand(bench, capsys):
    assert main(["bus-load", bench, "--simulate", "0", "--json"]) == 0
    (bus,), rows = found(capsys)
    # 55 + 10 bits a byte (Davis et al. 2007, eq. 1) of 8 us each.
    bits = {"SYNC": 55, "valve TPDO1": 95, "position TPDO1": 115, "valve RPDO1": 95}
    assert bus["load"] == pytest.approx((sum(bits.values()) / 10e-3 + 65 / 0.5) * 8e-6)
    # Each waits for those above it, after an SDO frame of 135 bits that was just begun.
    waited = 135
    for name, length in bits.items():
        waited += length
        assert rows[name]["response"] == pytest.approx(waited * 8e-6), name
    assert rows["position heartbeat"]["response"] == pytest.approx((waited + 65) * 8e-6)
    assert [rows[name]["why"] for name in bits] == ["cycle", "event timer", "SYNC", "cycle"]


def test_one_bus_needs_no_name_and_of_two_each_has_its_own(bench, capsys):
    assert main(["bus-load", bench, "--simulate", "0"]) == 0
    assert capsys.readouterr().out.startswith("load ")
    main(["bus-load", str(EXAMPLES / "two_buses.toml"), "--simulate", "0"])
    heads = [line for line in capsys.readouterr().out.splitlines() if "load " in line]
    assert [line.partition(": load ")[0] for line in heads] == list(
        load_config(EXAMPLES / "two_buses.toml").buses
    )


def test_a_simulation_stays_below_the_bounds_and_comes_near(bench, capsys):
    assert main(["bus-load", bench, "--simulate", "1", "--json"]) == 0
    (bus,), rows = found(capsys)
    for row in rows.values():
        assert 0 < row["simulated"] <= row["response"], row
    assert rows["SYNC"]["frames"] == 100
    assert rows["position heartbeat"]["frames"] in {2, 3}
    assert 0.7 * bus["load"] < bus["simulated_load"] < bus["load"]


def test_an_axis_whose_devices_are_on_two_buses_is_simulated_whole(cli):
    example = Path(__file__).parents[3] / "examples" / "two_buses.toml"
    content = json.loads(cli(["bus-load", str(example), "--simulate", "0.1", "--json"]).out)
    assert [bus["name"] for bus in content["buses"]] == ["bus", "sensors"]
    # In 0.1 s each message of 10 ms comes nine to eleven times, on its own bus alone.
    frames = {(row["bus"], row["name"]): row["frames"] for row in content["messages"]}
    assert {bus for bus, _ in frames} == {"bus", "sensors"}
    assert all(9 <= count <= 11 for count in frames.values()), frames


@pytest.mark.parametrize(
    ("options", "word"),
    [(["--max-load", "20"], "TOO MUCH"), (["--cycle-ms", "2"], "LATE"), (["-b", "20000"], "LATE")],
)
def test_beyond_a_limit_the_exit_code_is_1(bench, cli, options, word):
    assert word in cli(["bus-load", bench, "--simulate", "0", *options], 1).out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--cycle-ms", "0"], "--cycle-ms 0: give 0.1 to 10000"),
        (["--max-load", "nan"], "--max-load nan: give 1 to 100"),
    ],
)
def test_a_wrong_number_is_one_line(bench, cli, options, message):
    assert message in cli(["bus-load", bench, *options], 2).err


FD_DBC = """\
VERSION ""
BU_: pump
BO_ 291 State: 62 pump
 SG_ pressure : 480|16@1+ (0.1,0) [0|6553.5] "bar" pump
BO_ 385 Ours: 8 pump
BO_ 801 Motor: 3 pump
BO_ 802 Once: 3 pump
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG","StandardCAN_FD";
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 3600000;
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_ "VFrameFormat" BO_ 291 4;
BA_ "GenMsgCycleTime" BO_ 291 5;
BA_ "GenMsgCycleTime" BO_ 385 5;
BA_ "GenMsgCycleTime" BO_ 801 20;
"""


def test_messages_of_can_fd_have_both_bit_rates(make_file, capsys, cli):
    """At 500 kbit/s and 2 Mbit/s a frame of 64 bytes takes 32 + 679 bits at most, one with a 29-bit
    identifier 56 + 679, behind which it may have to wait; see test_fd_bits.py."""
    path = make_file("v.dbc", FD_DBC)
    words = ["bus-load", "--dbc", str(path), "-b", "500000", "--simulate", "5", "--json"]
    content = json.loads(cli([*words, "--fd", "--data-bitrate", "2000000"]).out)
    rows = {row["name"]: row for row in content["messages"]}
    state = rows["State"]
    assert (state["can_id"], state["length"], state["is_fd"], state["why"]) == (
        291,
        64,
        True,
        "DBC",
    )
    assert state["response"] == pytest.approx((32 + 56) * 2e-6 + 2 * 679 * 0.5e-6)
    assert 0 < state["simulated"] <= state["response"]
    assert state["frames"] == pytest.approx(1000, abs=1)
    assert "Motor" in rows
    assert "Ours" not in rows  # the identifier is that of a TPDO of the bench
    assert "Once" not in rows  # it has no cycle
    (bus,) = content["buses"]
    assert (bus["bitrate"], bus["data_bitrate"]) == (500_000, 2_000_000)
    assert main([*words[:-1], "--fd", "--data-bitrate", "2000000"]) == 0
    assert "of 500 kbit/s, data at 2 Mbit/s, simulated" in capsys.readouterr().out
    assert cli(words, 2).err == (
        "hil-bench: error: --dbc: State is of CAN FD, and the bus is classical; give fd = true in "
        "[bus], or --fd\n"
    )


def test_what_cannot_be_simulated_is_refused_and_bounds_need_no_simulation(monkeypatch, cli):
    """As without the ability that has wires: no table without the values that were asked for."""
    monkeypatch.setattr("hil_bench.abilities.eyes.verbs.bus_load.given_to", lambda _: [])
    told = cli("bus-load --simulate 1", 2)
    assert "--simulate: nothing here simulates a bus; give --simulate 0" in told.err
    assert told.out == ""
    assert main(["bus-load", "--simulate", "0"]) == 0
