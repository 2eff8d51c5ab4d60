"""The kind `program`: an unmodified Linux program with CAN sockets, on the bench's clock."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hil_bench.abilities.controllers.process.kind import EMPTY
from hil_bench.abilities.controllers.program.executable import find_fault
from hil_bench.abilities.controllers.seam import Controller, ControllerKind, Surroundings
from hil_bench.config.settings import Key
from hil_bench.config.values import choice, number, texts
from hil_bench.errors import ConfigError
from hil_bench.units import SECOND

BENCH_TIME, REAL_TIME = "bench", "real"


class ProgramKind(ControllerKind):
    """A program of this machine."""

    name = "program"
    summary = "a Linux program with SocketCAN, no line changed"
    keys = (
        Key("command", texts, example='["build/position_control", "--bus", "{bus}"]'),
        Key("time", choice((BENCH_TIME, REAL_TIME)), BENCH_TIME),
        Key("cpu_s_per_tick", number(SECOND, low=0.1), 5.0, SECOND),
    )

    def problems(self, settings: Mapping[str, Any], folder: Path) -> Sequence[str]:
        """Return why no library can be preloaded into the program, where it is there already."""
        del folder
        if not sys.platform.startswith("linux"):
            return ["kind: programs run on Linux; take another kind here"]
        command = settings["command"]
        if not command:
            return [EMPTY]
        fault = find_fault(command[0])
        return [f"command: {fault}"] if fault else ()

    def build(self, settings: Mapping[str, Any], surroundings: Surroundings) -> Controller:
        """Return the program, not yet started.

        Raises:
            ConfigError: no library can be preloaded into it.
        """
        from hil_bench.abilities.controllers.program.controller import (  # noqa: PLC0415 - seldom
            ProgramController,
        )
        from hil_bench.abilities.controllers.program.preload import find_library  # noqa: PLC0415

        if fault := find_fault(surroundings.filled(settings["command"][0])):
            raise ConfigError(f"{surroundings.place}.command: {fault}")
        return ProgramController(
            settings["command"],
            find_library(),
            settings["cpu_s_per_tick"],
            surroundings,
            is_real=settings["time"] == REAL_TIME,
        )


KIND = ProgramKind()
