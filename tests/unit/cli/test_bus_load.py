"""`hil-bench bus-load`: the numbers of a small bench, by hand."""

import json
from pathlib import Path

import pytest

from hil_bench.cli import main

BENCH = """\
[bus]
bitrate = 125_000
[nodes.valve]
profile = "valve_408"
node_id = 1
[nodes.position]
profile = "encoder_406"
node_id = 4
[nodes.position.objects]
"0x1800.02" = 1
"0x1017.00" = 500
"""


@pytest.fixture
def bench(tmp_path):
    path = tmp_path / "bench.toml"
    path.write_text(BENCH)
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


def test_a_simulation_stays_below_the_bounds_and_comes_near(bench, capsys):
    assert main(["bus-load", bench, "--simulate", "1", "--json"]) == 0
    (bus,), rows = found(capsys)
    for row in rows.values():
        assert 0 < row["simulated"] <= row["response"], row
    assert rows["SYNC"]["frames"] == 100
    assert rows["position heartbeat"]["frames"] in {2, 3}
    assert 0.7 * bus["load"] < bus["simulated_load"] < bus["load"]


def test_an_axis_whose_devices_are_on_two_buses_is_simulated_whole(capsys):
    example = Path(__file__).parents[3] / "examples" / "two_buses.toml"
    assert main(["bus-load", str(example), "--simulate", "0.1", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert [bus["name"] for bus in content["buses"]] == ["bus", "sensors"]
    # In 0.1 s each message of 10 ms comes nine to eleven times, on its own bus alone.
    frames = {(row["bus"], row["name"]): row["frames"] for row in content["messages"]}
    assert {bus for bus, _ in frames} == {"bus", "sensors"}
    assert all(9 <= count <= 11 for count in frames.values()), frames


@pytest.mark.parametrize(
    ("options", "word"),
    [(["--max-load", "20"], "TOO MUCH"), (["--cycle-ms", "2"], "LATE"), (["-b", "20000"], "LATE")],
)
def test_beyond_a_limit_the_exit_code_is_1(bench, capsys, options, word):
    assert main(["bus-load", bench, "--simulate", "0", *options]) == 1
    assert word in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--cycle-ms", "0"], "--cycle-ms 0: give 0.1 to 10000"),
        (["--max-load", "nan"], "--max-load nan: give 1 to 100"),
    ],
)
def test_a_wrong_number_is_one_line(bench, capsys, options, message):
    assert main(["bus-load", bench, *options]) == 2
    assert message in capsys.readouterr().err
