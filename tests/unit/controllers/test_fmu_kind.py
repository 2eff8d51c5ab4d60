"""Controllers as FMUs: one of PythonFMU drives the axis; the slider fails; tables are wrong."""

import importlib.util

import pytest
from support.fmus import CAN_BUILD, describe_2, write_fmu, write_law

from hil_bench import VirtualBench, load_config
from hil_bench.cli import main
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.errors import ConfigError, ControllerError

SCENARIO = """
title = "Holds its target, and again after a loss of power"
duration_s = 2.4

[controller]
kind = "fmu"
file = "control.fmu"
parameters = { gain = "{gain}" }

[controller.inputs]
axis1.position = { variable = "x", unit = "mm" }
target_mm = "w"

[controller.outputs]
axis1.spool_setpoint = { variable = "u", unit = "%" }

[parameters]
target_mm = 30.0
gain = 0.01

[[step]]
at_s = 1.6
firmware = "restart"

[[expect]]
id = "SRS-50"
that = "always from 1.2 s to 2.4 s abs(axis1.position - target_mm) < 2 mm"

[[expect]]
id = "SRS-51"
that = "within 0.5 s axis1.spool_setpoint > 20 %"
"""

needs_slider = pytest.mark.skipif(not CAN_BUILD, reason="needs gcc and fmpy")


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """Return the folder with the FMU that PythonFMU made of the law."""
    if any(importlib.util.find_spec(name) is None for name in ("fmpy", "pythonfmu")):
        pytest.skip("needs fmpy and pythonfmu")
    return write_law(tmp_path_factory.mktemp("exported")).parent


@pytest.mark.long
def test_one_of_another_tool_drives_the_axis_and_starts_anew(exported, capsys):
    (exported / "hold.scenario.toml").write_text(SCENARIO)
    assert main(["test", str(exported / "hold.scenario.toml")]) == ExitCode.DONE, (
        capsys.readouterr()
    )


def test_a_parameter_of_the_scenario_reaches_it(exported, cli):
    """With the sign turned round it drives away from its target."""
    wrong = exported / "away.scenario.toml"
    text = SCENARIO.replace("gain = 0.01", "gain = -0.02").replace(
        "duration_s = 2.4", "duration_s = 0.6"
    )
    wrong.write_text(
        text.replace("at_s = 1.6", "at_s = 0.5").replace("1.2 s to 2.4", "0.4 s to 0.6")
    )
    assert "SRS-50" in cli(["test", str(wrong)], ExitCode.CHECK_FAILED).out


TABLE = {
    "kind": "fmu",
    "file": "slider.fmu",
    "inputs": {"axis1.position": "F"},
    "outputs": {"axis1.spool_setpoint": {"variable": "x", "unit": "1"}},
}


def make_bench(folder, **more):
    table = {**TABLE, "folder": str(folder), **more}
    bench = {"tick_us": 1000}
    return VirtualBench(load_config(tables={"bench": bench, "controllers": {"mine": table}}))


@needs_slider
def test_the_same_bytes_with_either_version_of_fmi(tmp_path):
    """The slider is one program in both; its frames are, too."""
    inputs = {"axis1.position": {"variable": "u", "unit": "m"}}
    runs = []
    for version in (2, 3):
        write_fmu(tmp_path / "slider.fmu", version)
        with make_bench(tmp_path, inputs=inputs) as bench:
            bench.run(0.2)
            runs.append(list(bench.frames))
    assert runs[0] == runs[1]
    commands = [each for each in runs[0] if each.frame.can_id == 0x201]
    assert len(commands) > 20  # one each 2 ms, after the devices are set up


@needs_slider
@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"fails_at": 0.02}, r"slider\.fmu: at 0\.\d+ s: .*fmi2DoStep"),
        ({"breaks_at": 0.02}, r"at 0\.\d+ s: axis1\.spool_setpoint is nan; a finite number"),
        ({"crashes_at": 0.02}, r"at 0\.\d+ s: has crashed: SIG"),
        ({"gain": "{speed}"}, r"parameters: {speed} is no parameter of the scenario"),
    ],
)
def test_what_fails_is_one_line_and_leaves_the_bench_whole(tmp_path, parameters, words):
    write_fmu(tmp_path / "slider.fmu")
    inputs = {"axis1.position": {"variable": "u", "unit": "m"}}
    with (
        make_bench(tmp_path, inputs=inputs, parameters=parameters) as bench,
        pytest.raises(ControllerError, match=words) as error,
    ):
        bench.run(1.0)
    assert "\n" not in str(error.value)


@needs_slider
@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"file": "none.fmu"}, r"file: .*none.fmu: cannot be read"),
        ({"inputs": {"axis1.position": "G"}}, r"inputs: .G. is no variable of Slider"),
        ({"inputs": {"axis1.position": "v"}}, r"inputs: .v. is of causality local; input is"),
        ({"inputs": {"a b": "F"}}, r"inputs: .a b. cannot be a name; AXIS.QUANTITY"),
        ({"inputs": {"a.x": "u", "a.y": "u"}}, r"inputs: a.x and a.y are bound to one variable"),
        ({"inputs": 5}, r"inputs: 5 is not a table"),
        (
            {"outputs": {"target_mm": "x"}},
            r"outputs: .target_mm. is no quantity; write it as axis1",
        ),
        ({"parameters": {"gain": "fast"}}, r"parameters: gain = .fast. is no number"),
        ({"parameters": {"x": 1.0}}, r"parameters: .x. is of causality output"),
        ({"period_ms": 60.0}, r"period_ms: 60 is out of range"),
    ],
)
def test_a_wrong_table_is_one_line_before_the_run(tmp_path, more, words):
    write_fmu(tmp_path / "slider.fmu")
    with pytest.raises(ConfigError, match=words):
        make_bench(tmp_path, **more)


@needs_slider
@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"inputs": {"axis2.position": "F"}}, r"inputs: .axis2.position. is no .* measure"),
        ({"inputs": {"axis1.position": "F"}}, r"inputs: axis1.position is in m, and its .* in N"),
        ({"inputs": {"target_mm": "F"}}, r"inputs: .target_mm. is no parameter; the nearest is"),
        (
            {"outputs": {"axis1.position": "x"}},
            r"outputs: .* take; the nearest is axis1.spool_setpoint",
        ),
        ({"period_ms": 2.5}, r"period_ms: 2.5 ms is no multiple of the tick; give"),
    ],
)
def test_what_the_bench_does_not_have_is_one_line(tmp_path, more, words):
    write_fmu(tmp_path / "slider.fmu")
    with make_bench(tmp_path, **more) as bench, pytest.raises(ConfigError, match=words):
        bench.run(0.01)


@needs_slider
def test_a_step_that_the_fmu_does_not_take_is_refused(tmp_path):
    step, slave = '<DefaultExperiment stepSize="0.003"/>', ""
    write_fmu(tmp_path / "slider.fmu", description=describe_2(step, slave))
    with pytest.raises(
        ConfigError, match=r"period_ms: 2 ms is not the step of Slider, .*; 3 ms is right"
    ):
        make_bench(tmp_path)
