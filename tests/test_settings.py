"""What pyproject.toml sets for pytest holds for whoever runs a part of this checkout."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.slow_tests import LIST, function_of

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


def test_every_slow_test_is_there():
    listed = LIST.read_text(encoding="utf-8").split()
    assert listed
    gone = [name for name in listed if not _defines(name)]
    assert not gone, f"{LIST.name}: run tests/support/slow_tests.py, or take these out: {gone}"


def _defines(name):
    file, _, function = name.partition("::")
    path = ROOT / file
    return path.is_file() and f"def {function.rpartition('::')[2]}(" in path.read_text("utf-8")


def test_what_is_listed_is_slow(request):
    listed = set(LIST.read_text(encoding="utf-8").split())
    for item in request.session.items:
        if function_of(item.nodeid) in listed:
            assert item.get_closest_marker("slow"), item.nodeid
