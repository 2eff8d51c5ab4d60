"""The kind `process`: a program that joins the bench's hub and whose SYNC is its clock."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hil_bench.abilities.controllers.seam import Controller, ControllerKind, Surroundings
from hil_bench.config.settings import Key
from hil_bench.config.values import texts

EMPTY = 'command: is empty; give the program and its arguments, as in ["a", "-b"]'


class ProcessKind(ControllerKind):
    """A command line, started beside the bench."""

    name = "process"
    summary = "a program on the bench's hub, which sends SYNC"
    keys = (Key("command", texts, example='["build/position_control", "--bus", "{bus}"]'),)
    is_clock = True

    def problems(self, settings: Mapping[str, Any], folder: Path) -> Sequence[str]:
        """Return the fault of an empty command; the program may be built before the run."""
        return () if settings["command"] else [EMPTY]

    def build(self, settings: Mapping[str, Any], surroundings: Surroundings) -> Controller:
        """Start the program."""
        from hil_bench.abilities.controllers.process.controller import (  # noqa: PLC0415 - seldom
            ProcessController,
        )

        return ProcessController(settings["command"], surroundings)


KIND = ProcessKind()
