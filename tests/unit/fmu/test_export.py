"""An axis as an FMU: FMPy finds nothing wrong, and it moves as the axis does."""

import importlib.util
import math
import shlex
from pathlib import Path

import pytest
from support.tables import from_text

from hil_bench import ConfigError, load_config
from hil_bench.abilities.common.together import build_together
from hil_bench.abilities.fmu.export import export_axis, find_inputs, validate
from hil_bench.cli import main
from hil_bench.cli.exit_codes import ExitCode

ROOT = Path(__file__).parents[3]
DRUM = ROOT / "examples" / "machines" / "drum.toml"
CRANE = DRUM.with_name("crane.toml")
BACK = """
[bench]
step_us = 1000
[plant.axis1]
kind = "fmu"
file = "axis.fmu"
command = "spool_setpoint"
outputs = { position = "position", speed = "speed", P_A = "P_A", spool_position = "spool_position" }
inputs = { load = "load", supply_pressure = "supply_pressure" }
[nodes]
valve = { profile = "valve_408", node_id = 1 }
"""

pytestmark = pytest.mark.skipif(
    any(importlib.util.find_spec(name) is None for name in ("fmpy", "pythonfmu")),
    reason="needs fmpy and pythonfmu",
)


def export(folder, source=None):
    config = load_config(source)
    export_axis(config, config.axes[0], folder / "axis.fmu")
    return folder / "axis.fmu"


def test_fmpy_finds_nothing_wrong(tmp_path):
    assert validate(export(tmp_path)) == []


def test_the_axis_put_back_is_the_axis(tmp_path):
    """The same kernel makes the same steps; what differs is the rounding of the share."""
    export(tmp_path)
    (tmp_path / "bench.toml").write_text(BACK)
    own, back = load_config(), load_config(tmp_path / "bench.toml")
    axis, copy = own.axes[0], back.axes[0]
    plant, other = axis.kind.build(axis, own.dt), copy.kind.build(copy, back.dt)
    for tick in range(600):
        if tick == 300:
            for each in (plant, other):
                each.influence("load", 2000.0)
                each.influence("supply_pressure", 80e5)
        share = 0.7 * math.sin(tick * 0.01)
        seen = plant.drive(share * axis.full_scale, 20)
        shown = other.drive(share * copy.full_scale, 1)
        assert shown[:3] == pytest.approx(seen[:3], rel=1e-9, abs=1e-12)
        assert shown[3] / copy.full_scale == pytest.approx(seen[4] / axis.full_scale, abs=1e-12)
    assert abs(seen[0]) > 0.002  # it has moved


def test_a_motor_runs_in_fmpy(tmp_path):
    import fmpy  # noqa: PLC0415 - an extra

    path = export(tmp_path, DRUM)
    run = fmpy.simulate_fmu(
        str(path),
        stop_time=0.2,
        step_size=1e-3,
        output_interval=1e-3,
        start_values={"spool_setpoint": 0.5},
    )
    config = load_config(DRUM)
    axis = config.axes[0]
    plant = axis.kind.build(axis, config.dt)
    for _ in range(200):
        seen = plant.drive(0.5 * config.full_scale(axis), 20)
    assert run["speed"][-1] == pytest.approx(seen[1], rel=1e-9)
    assert run["angle"][-1] == pytest.approx(seen[0], rel=1e-9)


def test_each_quantity_has_its_unit(tmp_path):
    """Of SI, as FMI spells it: those of docs/plant.md."""
    import fmpy  # noqa: PLC0415 - an extra

    found = fmpy.read_model_description(str(export(tmp_path)))
    units = {each.name: each.unit for each in found.modelVariables}
    expected = {"position": "m", "speed": "m/s", "P_A": "Pa", "load": "N", "supply_pressure": "Pa"}
    assert {name: units[name] for name in expected} == expected
    assert set(expected.values()) <= {each.name for each in found.unitDefinitions}


def test_the_plants_own_step_is_the_shortest(tmp_path):
    import fmpy  # noqa: PLC0415 - an extra

    run = fmpy.simulate_fmu(
        str(export(tmp_path)), stop_time=1e-3, step_size=50e-6, output_interval=50e-6
    )
    assert run["time"][-1] == pytest.approx(1e-3)


def test_a_supply_of_one_axis_alone_has_its_input():
    config = load_config(CRANE)
    names = [each.name for each in find_inputs(config, list(config.axes))]
    assert names.count("supply_pressure") == 1
    alone = load_config(CRANE.with_name("tail_lift.toml"))
    assert "supply_pressure" in [each.name for each in find_inputs(alone, [alone.axes[0]])]


def test_axes_on_one_supply_are_one_fmu(tmp_path):
    """The crane with its load-sensing pump, against the bench's own group."""
    import fmpy  # noqa: PLC0415 - an extra

    path = export(tmp_path, CRANE)
    assert validate(path) == []
    run = fmpy.simulate_fmu(
        str(path),
        stop_time=0.3,
        step_size=1e-3,
        output_interval=1e-3,
        start_values={"boom.spool_setpoint": 0.5, "jib.spool_setpoint": 0.6},
    )
    config = load_config(CRANE)
    group = build_together(config, list(config.axes))
    commands = [0.5 * config.full_scale(config.axes[0]), 0.6 * config.full_scale(config.axes[1])]
    for _ in range(300):
        boom, jib = group.drive(commands, 20)
    assert run["boom.position"][-1] == pytest.approx(boom[0], rel=1e-9)
    assert run["jib.P_A"][-1] == pytest.approx(jib[2], rel=1e-9)
    assert run["jib.P_S"][-1] == run["boom.P_S"][-1] == pytest.approx(boom[8], rel=1e-9)
    assert run["jib.speed"][-1] > 0.01


def test_an_axis_alone_on_its_supply_keeps_its_names(tmp_path):
    import fmpy  # noqa: PLC0415 - an extra

    path = export(tmp_path, CRANE.with_name("tail_lift.toml"))
    run = fmpy.simulate_fmu(str(path), stop_time=0.1, step_size=2e-3, output_interval=2e-3)
    assert run["T_oil"][-1] > -10.0
    assert run["P_S"][-1] == pytest.approx(180.9e5, rel=1e-3)


@pytest.mark.long
def test_two_instances_live_side_by_side(tmp_path):
    """The first one goes on as if the second were not there."""
    export(tmp_path)
    (tmp_path / "bench.toml").write_text(BACK)
    config = load_config(tmp_path / "bench.toml")
    axis = config.axes[0]
    one, other = (axis.kind.build(axis, config.dt) for _ in range(2))
    for _ in range(100):
        one.drive(0.5 * axis.full_scale, 1)
    assert other.drive(0.0, 1)[0] == pytest.approx(0.0, abs=1e-15)
    assert one.output[0] > 1e-3


def test_a_step_that_is_no_multiple_is_refused(tmp_path):
    export(tmp_path)
    (tmp_path / "bench.toml").write_text(BACK.replace("step_us = 1000", "step_us = 125"))
    config = load_config(tmp_path / "bench.toml")
    plant = config.axes[0].kind.build(config.axes[0], config.dt)
    with pytest.raises(ConfigError, match="at 0 s: fmi2DoStep failed with status"):
        plant.drive(0.0, 1)


def test_only_axes_of_our_own_are_exported(tmp_path):
    export(tmp_path)
    (tmp_path / "bench.toml").write_text(BACK)
    config = load_config(tmp_path / "bench.toml")
    with pytest.raises(ConfigError, match=r"^plant.axis1: a fmu cannot be exported; give an axis"):
        export_axis(config, config.axes[0], tmp_path / "other.fmu")


@from_text("words", "message")
def test_the_verb(tmp_path, monkeypatch, capsys, words, message):
    monkeypatch.chdir(tmp_path)
    code = main(["export-fmu", *shlex.split(words)])
    out, err = capsys.readouterr()
    if message:
        assert (code, err.splitlines()[0]) == (ExitCode.USAGE, f"hil-bench: error: {message}")
    else:
        assert code == ExitCode.DONE
        size = Path("axis.fmu").stat().st_size / 1e6
        assert out == f"wrote axis.fmu: axis1, a hydraulic_cylinder, {size:.1f} MB\n"


def test_without_the_extra_it_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _name: None)
    config = load_config()
    with pytest.raises(ConfigError, match=r"needs PythonFMU and FMPy.*hil-bench\[fmu\]"):
        export_axis(config, config.axes[0], tmp_path / "axis.fmu")
