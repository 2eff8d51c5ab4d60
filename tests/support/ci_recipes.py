"""Runs the commands of examples/ci as a CI machine would: in a copy, one after the other.

As a program, ``ci_recipes.py FILE JOB``, it prints all commands of a job, for .ci/run.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[2]
RECIPES = (
    ROOT / "examples" / "ci" / "github-actions.yml",
    ROOT / "examples" / "ci" / "gitlab-ci.yml",
)

PREPARATION = ("pip install", "apt-get", "modprobe")
"""What prepares a runner: .ci/run does the first of these from the wheel; the tests' machine has
the others done already."""


def all_commands_of(recipe, job):
    """Return the commands of a job of a GitHub Actions workflow or a GitLab CI configuration."""
    content = yaml.safe_load(Path(recipe).read_text(encoding="utf-8"))
    if "jobs" in content:
        scripts = [step["run"] for step in content["jobs"][job]["steps"] if "run" in step]
    else:
        scripts = [*content[job].get("before_script", ()), *content[job]["script"]]
    return [line for script in scripts for line in script.splitlines()]


def commands_of(recipe, job):
    """Return the commands of a job without those that prepare its machine."""
    lines = all_commands_of(recipe, job)
    return [line for line in lines if not any(word in line for word in PREPARATION)]


def run_commands(commands, directory):
    """Run them where the recipe's files are; the first that fails ends it."""
    shutil.copytree(
        ROOT / "examples" / "firmware",
        directory / "examples" / "firmware",
        ignore=shutil.ignore_patterns("build", "__pycache__"),
    )
    tools = directory / "tools"
    tools.mkdir()
    (tools / "sudo").write_text('#!/bin/sh\nexec "$@"\n')  # the test is root, or need not be
    (tools / "sudo").chmod(0o755)
    path = os.pathsep.join([str(tools), str(Path(sys.executable).parent), os.environ["PATH"]])
    options = os.environ.get("PYTEST_ADDOPTS", "") + " -p no:cacheprovider"
    # One worker for `-n auto`: the tests around these keep the processors busy already.
    settings = {"PATH": path, "PYTEST_ADDOPTS": options, "PYTEST_XDIST_AUTO_NUM_WORKERS": "1"}
    return subprocess.run(  # noqa: S603 - our own recipe
        ["/bin/bash", "-euxo", "pipefail", "-c", "\n".join(commands)],
        cwd=directory,
        env=os.environ | settings,
        capture_output=True,
        text=True,
        check=False,
    )


if __name__ == "__main__":
    sys.stdout.write("\n".join([*all_commands_of(*sys.argv[1:]), ""]))
