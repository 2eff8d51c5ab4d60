"""Faults of a file and of the examples, and what the document says of them."""

import re
import runpy
from pathlib import Path

import can
import pytest

from hil_bench import VirtualBench, load_config
from hil_bench.abilities.faults.registry import FAULT_KINDS
from hil_drivers import PressureSensor

pytest_plugins = ["pytester"]

BAR = 1e5

FAULTY = """
[nodes]
valve = { profile = "valve_408", node_id = 1 }
pressure_a = { profile = "pressure_404", node_id = 2, source = "P_A" }

[[faults]]
kind = "offset"
target = "pressure_a"
offset_bar = 20
at_s = 0.1
for_s = 0.05

[[faults]]
kind = "noise"
target = "pressure_a"
noise_bar = 2
at_s = 0.2

[[faults]]
kind = "lose"
target = "pressure_a"
share_percent = 30
at_s = 0.05
"""


def trace(tmp_path, seed=1):
    """Return all frames of half a second with the faults above, after NMT start."""
    path = tmp_path / "bench.toml"
    path.write_text(FAULTY)
    with VirtualBench(load_config(path, seed=seed)) as bench:
        bench.run(0.002)
        bench.bus.send(can.Message(arbitration_id=0, data=b"\x01\x00", is_extended_id=False))
        bench.run(0.5)
        return list(bench.frames)


def test_faults_of_the_file_happen_by_themselves(load_bench):
    with VirtualBench(load_bench(FAULTY)) as bench:
        pressures = []
        for _ in range(160):
            bench.run(0.001)
            shown = bench.bench.nodes[1].object_dictionary.find(0x6130, 1).value
            pressures.append(shown - bench.signals["axis1.P_A"][-1] / BAR)
    # Ticks 100 to 149 of those that are counted from 1 have the offset.
    assert pressures[:99] == pytest.approx([0.0] * 99, abs=1e-4)
    assert pressures[99:149] == pytest.approx([20.0] * 50, abs=1e-4)
    assert pressures[149:] == pytest.approx([0.0] * 11, abs=1e-4)


def test_the_same_seed_gives_the_same_faults(tmp_path):
    first, again, other = trace(tmp_path), trace(tmp_path), trace(tmp_path, seed=2)
    assert first == again
    assert first != other


def test_a_fault_changes_no_other_node(bench, network):
    """The pressure at B is what it is without a fault at A."""
    sensor = PressureSensor(network, 3)
    sensor.setup(transmission_type=254, event_timer=0.005)
    network.start_node(3)
    bench.faults.offset("pressure_a", 20 * BAR)
    bench.faults.silence("pressure_a")
    bench.run(0.05)
    assert sensor.pressure == pytest.approx(bench.signals["axis1.P_B"][-1], rel=1e-6)


def test_the_document_shows_what_works(pytester):
    text = (Path(__file__).parents[2] / "docs" / "faults.md").read_text(encoding="utf-8")
    (snippet,) = re.findall(r"^```py\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    pytester.makepyfile(snippet)
    pytester.runpytest().assert_outcomes(passed=1)


def test_the_example_tells_how_far_the_piston_was_off(capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["broken_sensor.py"])
    runpy.run_path(
        str(Path(__file__).parents[2] / "examples/broken_sensor.py"), run_name="__main__"
    )
    off = dict(re.findall(r"^(.+?)  +([\d.]+) mm off", capsys.readouterr().out, re.MULTILINE))
    assert float(off["before the first"]) < 0.3
    # The controller brings what it measures to the set-point, so the piston 5 mm away from it.
    assert float(off["position offset 5 mm"]) == pytest.approx(5.0, abs=0.3)
    # At full opening, 0.29 m/s, for most of 0.3 s.
    assert 30.0 < float(off["position frozen"]) < 0.3 * 290.0


def test_the_document_has_each_kind():
    text = (Path(__file__).parents[2] / "docs" / "faults.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE) == [*FAULT_KINDS.built_in]
