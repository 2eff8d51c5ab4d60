"""The CANopen device needs nothing else of the bench: it could be published by itself."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import hil_bench.canopen_device

DEVICE = Path(hil_bench.canopen_device.__file__).parent
ROOT = Path(__file__).parents[2]
TESTS = ROOT / "tests" / "unit" / "canopen_device"


@pytest.fixture
def run_alone(tmp_path):
    """Run Python where `hil_bench` has one package and nothing else."""
    package = tmp_path / "hil_bench"
    shutil.copytree(DEVICE, package / DEVICE.name, ignore=shutil.ignore_patterns("__pycache__"))
    (package / "__init__.py").touch()
    # Other plugins of pytest, that of the bench among them, are installed; none is loaded.
    alone = {"PYTHONPATH": str(tmp_path), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}

    def run(*arguments):
        return subprocess.run(  # noqa: S603 - our own tests
            [sys.executable, *arguments],
            cwd=tmp_path,
            env=os.environ | alone,
            capture_output=True,
            text=True,
            check=False,
        )

    return run


def test_the_rest_of_the_bench_is_not_there(run_alone):
    result = run_alone("-c", "import hil_bench.errors")
    assert "No module named 'hil_bench.errors'" in result.stderr


def test_each_module_is_imported_alone(run_alone):
    names = sorted(f"hil_bench.canopen_device.{path.stem}" for path in DEVICE.glob("*.py"))
    result = run_alone("-c", f"import {', '.join(names)}".replace(".__init__", ""))
    assert result.returncode == 0, result.stderr


@pytest.mark.long  # all tests of a package, in an interpreter of their own
def test_its_tests_pass_alone(run_alone):
    options = ["-q", "-p", "no:cacheprovider", "-p", "_hypothesis_pytestplugin"]
    result = run_alone(
        "-m", "pytest", *options, "--hypothesis-profile=brief", "-m", "not slow", str(TESTS)
    )
    assert result.returncode == 0, result.stdout
