# ruff: noqa: E501 - one message a line
"""What is wrong with an FMU, or with what is bound of it: one line each."""

import zipfile

import pytest
from support.fmus import describe_2, describe_3, write_fmu

from hil_bench.cli import main
from hil_bench.cli.exit_codes import ExitCode
from hil_bench.errors import ConfigError

FIXED = 'canHandleVariableCommunicationStepSize="false"'
STEP = '<DefaultExperiment stepSize="0.002"/>'


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"file": None}, 'plant.axis1.file: missing; give for example file = "axis.fmu"'),
        ({"file": '"other.fmu"'}, "other.fmu: cannot be read: No such file or directory; give an FMU"),
        ({"command": '"w"'}, 'plant.axis1.command: "w" is no variable of Slider; the nearest input is u'),
        ({"command": '"x"'}, 'plant.axis1.command: "x" is of causality output; input is right'),
        ({"full_command": "0"}, "plant.axis1.full_command: 0 moves nothing; give the input's value at 100 %"),
        ({"outputs": '{ position = "y" }'}, 'plant.axis1.outputs: "y" is no variable of Slider; the nearest output is x'),
        ({"outputs": '{ position = "u" }'}, 'plant.axis1.outputs: "u" is of causality input; output or local is right'),
        ({"outputs": '{ position = "count" }'}, 'plant.axis1.outputs: "count" is no scalar Real or Float64; bind one that is'),
        ({"outputs": '{ position = { variable = "x", unit = "furlong" } }'}, 'plant.axis1.outputs: position: "furlong" is no known unit'),
        ({"outputs": '{ "a b" = "x" }'}, 'plant.axis1.outputs: "a b" cannot be a name'),
        ({"outputs": '"x"'}, 'plant.axis1.outputs: "x" is not a table; give NAME = "VARIABLE"'),
        ({"inputs": '{ load = "x" }'}, 'plant.axis1.inputs: "x" is of causality output; input is right'),
        ({"parameters": "{ u = 1 }"}, 'plant.axis1.parameters: "u" is of causality input; parameter is right'),
        ({"outputs": '{ speed = "v" }'}, "nodes.position.axis: the plant is a fmu and has no position"),
    ],
)  # fmt: skip
def test_a_binding_that_is_wrong_is_one_line(load, keys, message):
    with pytest.raises(ConfigError) as caught:
        load(**keys)
    line, *others = str(caught.value).splitlines()
    assert message in line
    # Without its outputs, an axis has nothing to bind to either.
    assert all("nodes.position.axis: the plant is a fmu and has no" in each for each in others)


@pytest.mark.parametrize(
    ("version", "description", "step_us", "message"),
    [
        (2, describe_2(STEP, FIXED), 1000, "bench.step_us: 1000 is not the step of Slider, which takes no other; give 2000 for plant.axis1"),
        (3, describe_3(f'{FIXED} fixedInternalStepSize="0.0003"'), 1000, "bench.step_us: 1000 is no multiple of the internal step of Slider; give a multiple of 300 for plant.axis1"),
        (2, describe_2(STEP, FIXED), 2000, ""),
        (3, describe_3(f'{FIXED} fixedInternalStepSize="0.0005"'), 1000, ""),
        (2, describe_2(STEP), 1000, ""),
        (2, describe_2(slave=FIXED), 1000, ""),
    ],
)  # fmt: skip
def test_the_communication_step_is_one_that_the_fmu_takes(
    load, version, description, step_us, message
):
    bench = f"tick_us = 6000\nstep_us = {step_us}"
    if not message:
        load(version, bench=bench, description=description)
        return
    with pytest.raises(ConfigError) as caught:
        load(version, bench=bench, description=description)
    assert str(caught.value).endswith(message)


def test_an_fmu_for_another_platform(load, tmp_path):
    write_fmu(tmp_path / "slider.fmu", platform="win64")
    with pytest.raises(ConfigError, match=r"is for another platform: win64; .* is right here"):
        load()


def test_model_exchange_has_no_solver(load):
    text = describe_2().replace("CoSimulation", "ModelExchange")
    with pytest.raises(ConfigError, match="is for model exchange, without a solver; export it"):
        load(description=text)


@pytest.mark.parametrize(
    "text", ["no xml", "<a/>", '<fmiModelDescription fmiVersion="1.0"/>', "<fmiModelDescription/>"]
)
def test_a_description_that_is_none(load, text):
    with pytest.raises(ConfigError) as caught:
        load(description=text)
    (line,) = str(caught.value).splitlines()
    assert "modelDescription.xml cannot be read: " in line or "FMI 2.0 or 3.0" in line


def test_a_file_that_is_no_zip(load, tmp_path):
    (tmp_path / "slider.fmu").write_bytes(b"no zip")
    with pytest.raises(ConfigError, match=r"is no FMU: it is not a zip file$"):
        load()


def test_a_zip_that_is_no_fmu(load, tmp_path):
    with zipfile.ZipFile(tmp_path / "slider.fmu", "w") as archive:
        archive.writestr("readme", "")
    with pytest.raises(ConfigError, match=r"is no FMU: it has no modelDescription\.xml$"):
        load()


@pytest.mark.parametrize("name", ["../x", "/x", "a/../../x", "C:x", "a\\..\\x"])
def test_a_zip_that_writes_beside_its_folder(load, tmp_path, name):
    write_fmu(tmp_path / "slider.fmu")
    with zipfile.ZipFile(tmp_path / "slider.fmu", "a") as archive:
        archive.writestr(name, "")
    with pytest.raises(ConfigError, match="would be written outside of it; such a file is no FMU"):
        load()


def test_a_zip_with_a_link(load, tmp_path):
    write_fmu(tmp_path / "slider.fmu")
    link = zipfile.ZipInfo("resources/link")
    link.external_attr = 0o120777 << 16
    with zipfile.ZipFile(tmp_path / "slider.fmu", "a") as archive:
        archive.writestr(link, "/etc/passwd")
    with pytest.raises(ConfigError, match="is a link; such a file is no FMU"):
        load()


def test_a_scenario_on_an_fmu_that_fails_ends_in_one_line(load, tmp_path, cli):
    load(parameters="{ fails_at = 0.5 }")
    scenario = tmp_path / "t.scenario.toml"
    scenario.write_text(
        'title = "t"\nbench = "bench.toml"\nduration_s = 1.0\n[[expect]]\nid = "A"\nthat = "always axis1.position < 1 m"\n'
    )
    out = cli(["test", str(scenario)], ExitCode.CHECK_FAILED).out
    lines = [line for line in out.splitlines() if "slider.fmu" in line]
    assert len(lines) == 1
    assert "Traceback" not in out
    assert (
        "at 0.499 s: fmi2DoStep failed with status 3 (error): the slider has left its rail"
        in lines[0]
    )


def test_check_prints_what_is_bound(load, tmp_path, capsys):
    load()
    assert main(["check", str(tmp_path / "bench.toml")]) == 0
    assert 'outputs = { "position" = { "variable" = "x" }' in capsys.readouterr().out
