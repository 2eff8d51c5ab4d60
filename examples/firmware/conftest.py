"""Builds the controller and starts it as the bench's time demands."""

import subprocess
from pathlib import Path

import pytest

HERE = Path(__file__).parent


@pytest.fixture(scope="session")
def controller(tmp_path_factory):
    """The controller, built by the system's compiler."""
    build = tmp_path_factory.mktemp("build")
    subprocess.run(["make", "--silent", "-C", HERE, f"BUILD={build}"], check=True)
    return build / "position_control"


@pytest.fixture
def start(firmware, controller, hil_config, hil_realtime):
    """Start the controller on the bench: ``start("--targets-mm", 50)``."""
    period = ["--period-us", hil_config.sync_period_ns // 1000]
    timing = period if hil_realtime else [*period, "--lockstep"]
    return lambda *arguments: firmware(controller, "--bus", "{bus}", *timing, *arguments)
