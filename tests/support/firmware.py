"""The example's firmware in C, built, and a session of it with a bench in lock-step."""

import subprocess
from pathlib import Path

from hil_bench.abilities.lockstep.firmware import FirmwareBus
from hil_bench.bench.virtual_bench import VirtualBench

EXAMPLE = Path(__file__).parents[2] / "examples" / "firmware"


def build_controller(directory):
    """Return the controller, built into a directory."""
    make = ["make", "--silent", "-C", EXAMPLE, f"BUILD={directory}"]
    subprocess.run(make, check=True)  # noqa: S603 - our own Makefile
    return directory / "position_control"


def run_session(controller, channel, targets_mm, directory):
    """Return the frames and the signals of a session."""
    with VirtualBench() as bench:
        bus = FirmwareBus(bench, channel, is_realtime=False)
        try:
            command = [controller, "--bus", "{bus}", "--lockstep", "--targets-mm", targets_mm]
            assert bus.start(command, directory).wait(timeout=5.0) == 0
        finally:
            bus.close()
        return list(bench.frames), bench.signals
