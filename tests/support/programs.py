"""Programs for tests of the kind `program`, and the bench's side of one, tick by tick."""

import os
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

import pytest

from hil_bench.abilities.controllers.program.kind import KIND
from hil_bench.abilities.controllers.seam import ControllerEnd, Surroundings, TimedFrame

SOURCE = Path(__file__).with_name("can_program.c")
TICK = 1_000_000  # [ns]

needs_compiler = pytest.mark.skipif(
    shutil.which("cc") is None and not os.environ.get("CI"), reason="needs a C compiler"
)


def build_can_program(folder):
    """Compile the program whose parts `can_program.c` lists."""
    program = folder / "can_program"
    warnings = ["-Wall", "-Wextra", "-Werror"]
    subprocess.run(["cc", "-O1", *warnings, "-o", program, SOURCE], check=True)  # noqa: S603, S607
    return program


def surroundings_of(scratch, *buses):
    return Surroundings(
        "firmware", "[controller]", scratch, scratch, buses or ("bus",), None, {}, TICK
    )


def build_program(command, scratch, *buses, cpu_s=5.0, time="bench"):
    settings = {"command": tuple(map(str, command)), "time": time, "cpu_s_per_tick": cpu_s}
    return KIND.build(settings, surroundings_of(scratch, *buses))


class Life(NamedTuple):
    """What a program did: frames with their times [us], output, and how it ended."""

    sent: list
    lines: list
    ending: str


def live(controller, ticks, received=None):
    """Let a controller live on from 0, `received` being frames by the time [us] they come at."""
    received = {time * 1000: frames for time, frames in (received or {}).items()}
    sent, ending = [], "lives"
    try:
        for now in range(0, ticks * TICK, TICK):
            times = [time for time in received if now <= time < now + TICK]
            frames = [TimedFrame(time, frame) for time in times for frame in received[time]]
            sent += controller.advance(now + TICK, frames)
    except ControllerEnd as end:
        sent += end.sent
        ending = str(end)
    return Life(
        [(time / 1000, frame) for time, frame in sent], controller.tail().splitlines(), ending
    )
