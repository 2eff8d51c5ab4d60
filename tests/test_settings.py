"""What pyproject.toml sets for pytest holds for whoever runs a part of this checkout."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def test_what_hangs_is_ended(pytestconfig):
    if not pytestconfig.pluginmanager.hasplugin("timeout"):
        pytest.skip("no pytest-timeout; pip install -e '.[test]'")
    assert pytestconfig._env_timeout


def test_the_example_runs_with_pytest_alone():
    plugins = {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "PYTEST_PLUGINS": "hil_bench.pytest_plugin"}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "--collect-only", "-q", "examples/firmware"],
        cwd=ROOT,
        env=os.environ | plugins,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "test_it_says_what_it_does" in done.stdout
