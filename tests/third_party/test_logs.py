"""Logs and recordings with J1939, and MF4 of other tools: what asammdf reads, and we by way of it.

Skipped where asammdf is not installed; `.ci/run` has an environment with it.
"""

from pathlib import Path

import can
import pytest

from hil_bench.cli import main

asammdf = pytest.importorskip("asammdf")  # after can, or python-can would not find it

BENCH = """\
[plant.axis1]

[j1939.valve]
kind = "auxiliary_valve"
address = 128
[j1939.sensor]
address = 140
[j1939.sensor.signals]
p = { pgn = 0xFF10, start_bit = 0, length = 16, resolution = 0.5, unit = "bar", rate_ms = 50 }
"""

# 65072: 125 x 0.4 % = 50 %, extend. 65296: 200 x 0.5 bar. 65040: 100 - 125 = -25 %.
LOG = """\
(0.000000) can0 0CFE3027#7DFFF1FFFFFFFFFF
(0.001000) can0 18FF108C#C800FFFFFFFFFFFF
(0.002000) can0 0CFE1080#6496F21FC0FFFFFF
"""


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bench.toml").write_text(BENCH)
    (tmp_path / "t.log").write_text(LOG)


def test_asammdf_reads_j1939_signals_with_their_units():
    assert main(["decode", "t.log", "bench.toml", "-o", "d.mf4"]) == 0
    with asammdf.MDF("d.mf4") as mdf:
        found = {name: mdf.get(name) for name in ("valve.spool_setpoint", "valve.flow", "sensor.p")}
    assert found["valve.spool_setpoint"].samples.tolist() == [0.5] * 3
    assert found["sensor.p"].samples.tolist()[1:] == [100e5] * 2
    assert found["valve.flow"].samples.tolist()[2:] == [-0.25]
    assert [signal.unit for signal in found.values()] == ["-", "-", "Pa"]
    assert found["sensor.p"].timestamps.tolist() == pytest.approx([0.0, 0.001, 0.002])


def test_an_mf4_of_another_tool_is_decoded_as_a_log_is(capsys):
    with can.LogReader("t.log") as reader, can.Logger("foreign.mf4") as writer:
        for message in reader:
            message.channel = 1
            writer(message)
    shown = []
    for name in ("t.log", "foreign.mf4"):
        assert main(["decode", name, "bench.toml"]) == 0
        shown.append(capsys.readouterr().out)
    assert "sensor" in shown[0]
    assert shown[0] == shown[1]


def test_what_only_looks_like_an_mf4_is_one_line(cli):
    Path("x.mf4").write_bytes(b"MDF     4.10    made up " + bytes(2000))
    said = cli("decode x.mf4", 2).err
    assert said.count("\n") == 1
    assert "x.mf4: is no recording of hil-bench" in said
