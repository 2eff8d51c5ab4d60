"""Container file, GitHub action and GitLab template: their syntax, and that they say the same."""

import json
import re
import shlex
import shutil
import subprocess
import tomllib

import pytest
import yaml
from support.documents import ROOT

from hil_bench.cli import build_parser
from hil_bench.cli.parser import own_verbs

ACTION = ROOT / "examples" / "ci" / "action" / "action.yml"
TEMPLATE = ROOT / "examples" / "ci" / "gitlab-template.yml"
CONTAINERFILE = ROOT / "Containerfile"


def action():
    return yaml.safe_load(ACTION.read_text(encoding="utf-8"))


def template():
    (job,) = yaml.safe_load(TEMPLATE.read_text(encoding="utf-8")).values()
    return job


def action_scripts():
    return [step["run"] for step in action()["runs"]["steps"] if "run" in step]


def template_scripts():
    job = template()
    return [line for part in ("before_script", "script", "after_script") for line in job[part]]


def instructions():
    """Instruction and rest of each line of the container file, continued lines joined."""
    text = CONTAINERFILE.read_text(encoding="utf-8").replace("\\\n", " ")
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    return [tuple(line.split(None, 1)) for line in lines]


SHELL = [
    *action_scripts(),
    *template_scripts(),
    *(rest for instruction, rest in instructions() if instruction == "RUN"),
]


@pytest.mark.parametrize("script", SHELL)
def test_each_script_is_a_script(script):
    done = subprocess.run(  # noqa: S603 - our own recipe, which is only read
        [shutil.which("bash"), "-n", "-c", script], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_action_and_template_do_the_same():
    action_lines = [line for script in action_scripts() for line in script.splitlines()]
    assert action_lines == template_scripts()


@pytest.mark.parametrize("line", [each for each in template_scripts() if "hil-bench " in each])
def test_each_command_is_one_of_the_command_line(line):
    program, *arguments = shlex.split(line)
    assert program == "hil-bench"
    build_parser(own_verbs(), own_verbs()).parse_args(arguments)


def test_the_action_is_what_github_asks_of_a_composite_one():
    content = action()
    assert {"name", "description", "inputs", "runs"} <= content.keys()
    assert content["runs"]["using"] == "composite"
    for step in content["runs"]["steps"]:
        assert ("uses" in step) is not ("run" in step)
        assert "uses" in step or step["shell"] == "bash"  # a composite step has no default
        # An input in a script would be run as one: it may come by the environment only.
        assert "${{" not in step.get("run", "")
    named = set(re.findall(r"inputs\.(\w+)", ACTION.read_text(encoding="utf-8")))
    assert named == content["inputs"].keys()


def test_each_variable_of_a_script_is_set():
    known = {"SCENARIOS", *template()["variables"]}
    assert set(re.findall(r"\$\{?(\w+)", "\n".join(template_scripts()))) <= known
    for step in action()["runs"]["steps"]:
        used = set(re.findall(r"\$\{?(\w+)", step.get("run", "")))
        assert used <= step.get("env", {}).keys()


def test_the_extras_are_those_of_the_project():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    for script in SHELL:
        for listed in re.findall(r"\[([\w,]+)\]\"", script):
            assert set(listed.split(",")) <= extras.keys()


def test_the_container_file_builds_a_wheel_and_runs_the_program_of_it():
    known = {"FROM", "WORKDIR", "COPY", "RUN", "USER", "ENTRYPOINT", "CMD"}
    found = instructions()
    assert {instruction for instruction, _ in found} <= known
    assert found[0] == ("FROM", "python:3.12-slim-bookworm AS build")
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]
    (entry,) = [json.loads(rest) for instruction, rest in found if instruction == "ENTRYPOINT"]
    assert entry == list(scripts)
    (copied,) = re.findall(r"--from=(\w+)", CONTAINERFILE.read_text(encoding="utf-8"))
    assert copied == "build"
    users = [rest for instruction, rest in found if instruction == "USER"]
    assert users == ["bench"]  # not root
