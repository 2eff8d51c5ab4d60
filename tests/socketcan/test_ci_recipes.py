"""The job of examples/ci that tests firmware on SocketCAN, in lock-step and in real time, run."""

import subprocess

from support.ci_recipes import RECIPES, commands_of, run_commands


def test_the_job_with_vcan_passes(tmp_path, channel):
    subprocess.run(["ip", "link", "del", channel], check=True)  # the recipe makes it
    done = run_commands(commands_of(RECIPES[0], "vcan"), tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
