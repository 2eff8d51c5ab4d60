"""Record as a test: what was clicked becomes a scenario file, and runs at once."""

import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from hil_bench.abilities.controllers.python.kind import EXAMPLES
from hil_bench.abilities.panel.own_program import run_words
from hil_bench.abilities.scenario.records import Controller, Expectation, Scenario
from hil_bench.abilities.scenario.writing import JournalSteps, to_toml
from hil_bench.errors import ConfigError

SUFFIX = ".scenario.toml"

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,60}")
_LONGEST = 600.0  # of a test [s]
_PATIENCE = 120.0  # with a test [s]
_MOST_OUTPUT = 1 << 20
_VERDICTS = {0: "passed", 1: "failed", 6: "undecided"}


class RecordForm(NamedTuple):
    """The contents of a test's form.

    Attributes:
        file: its name, without folder and suffix.
        title: in words.
        begin_s: bench time at which it begins [s].
        end_s: bench time at which it ends [s].
        lead_s: time before that for the controller to start [s].
        controller: the name of an example; empty for none.
        requirement: its id.
        that: what is required, in the language of expectations.
    """

    file: str
    title: str
    begin_s: float
    end_s: float
    lead_s: float
    controller: str
    requirement: str
    that: str

    def check(self) -> None:
        """Refuse what cannot be; the text of the requirement is for the run.

        Raises:
            ConfigError: something is wrong.
        """
        if not _NAME.fullmatch(self.file):
            raise ConfigError(f"file {self.file!a}: give up to 61 letters, digits, _ or -")
        if not 0.0 < self.end_s - self.begin_s <= _LONGEST:
            raise ConfigError(
                f"from {self.begin_s:g} s to {self.end_s:g} s: give a time of up to {_LONGEST:g} s"
            )
        if not 0.0 <= self.lead_s <= _LONGEST:
            raise ConfigError(f"lead {self.lead_s:g} s: give 0 to {_LONGEST:g} s")
        if self.controller and self.controller not in EXAMPLES:
            known = ", ".join(EXAMPLES)
            raise ConfigError(f"controller {self.controller!a}: give one of {known}, or none")
        if not (self.title.strip() and self.requirement.strip() and self.that.strip()):
            raise ConfigError("give a title, an id and a requirement")


def make_scenario(
    form: RecordForm, path: Path, hello: Mapping[str, Any], journal: Mapping[str, Any]
) -> tuple[Scenario, list[str]]:
    """Return the scenario of a form, and what it leaves out; `ConfigError` for a wrong form."""
    form.check()
    maker = JournalSteps(hello, form.begin_s, form.end_s, form.lead_s)
    maker.add(journal["entries"])
    remarks = list(maker.remarks)
    if journal["forgotten"]:
        remarks.append(f"{journal['forgotten']} older commands are forgotten")
    file = hello.get("bench_file")
    scenario = Scenario(
        path=path,
        title=form.title,
        bench=os.path.relpath(file, path.parent) if file else None,
        duration=round(form.end_s - form.begin_s + form.lead_s, 9),
        requirement_ids=(form.requirement,),
        controller=Controller(example=form.controller) if form.controller else None,
        parameters=(),
        steps=maker.steps,
        expectations=(Expectation(form.requirement, form.that),),
    )
    return scenario, remarks


def write_test(scenario: Scenario, *, replaces: bool) -> None:
    """Write a scenario to its path.

    Raises:
        ConfigError: a file of this name is there, or it cannot be written.
    """
    path = scenario.path
    try:
        with path.open("w" if replaces else "x", encoding="utf-8") as file:
            file.write(to_toml(scenario))
    except FileExistsError:
        raise ConfigError(f"{path} is there already; give another name, or replace it") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from None


async def play_test(path: Path) -> dict[str, Any]:
    """Play a scenario in a process of its own, and return its verdict and what was found.

    One that takes too long is a `ControllerError`.

    Raises:
        ConfigError: it cannot be played.
    """
    late = f"{path}: not done after {_PATIENCE:g} s; ended"
    code, output, errors = await run_words(["test", str(path), "--json"], _PATIENCE, late)
    if code not in _VERDICTS:
        raise ConfigError(errors[-_MOST_OUTPUT:].decode(errors="replace").strip())
    (result,) = json.loads(output).values()
    return {"verdict": _VERDICTS[code], "result": result}
