"""Runs the commands of examples/ci as a CI machine would: in a copy, one after the other."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
RECIPES = (
    ROOT / "examples" / "ci" / "github-actions.yml",
    ROOT / "examples" / "ci" / "gitlab-ci.yml",
)

PREPARATION = ("pip install", "apt-get", "modprobe")
"""What prepares a runner: .ci/run does the first of these from the wheel; the tests' machine has
the others done already."""


def commands_of(recipe, job):
    """Return the commands of a job without those that prepare its machine."""
    command = [sys.executable, ROOT / ".ci" / "recipe.py", recipe, job]
    done = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603
    lines = done.stdout.splitlines()
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
    return subprocess.run(  # noqa: S603 - our own recipe
        ["/bin/bash", "-euxo", "pipefail", "-c", "\n".join(commands)],
        cwd=directory,
        env=os.environ | {"PATH": path, "PYTEST_ADDOPTS": options},
        capture_output=True,
        text=True,
        check=False,
    )
