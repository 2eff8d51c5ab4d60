"""Recordings by the panel: of a run, as a scenario, replayed, exported."""

import asyncio
import base64
import json
import os
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hil_bench.abilities.common.files import scratch_folder
from hil_bench.abilities.controllers.python.kind import EXAMPLES
from hil_bench.abilities.panel.layouts import write_named
from hil_bench.abilities.recording.mdf_writer import MdfFile
from hil_bench.abilities.scenario.records import Controller, Expectation, Scenario
from hil_bench.abilities.scenario.writing import JournalSteps, to_toml
from hil_bench.errors import ConfigError, ControllerError
from hil_bench.outside.recording.channels import TIME, Channel, recording_dtype

# This program again, in a process of its own, for what a page asks for.


async def run_words(
    words: Sequence[str], patience: float, late: str
) -> tuple[int | None, bytes, bytes]:
    """Return exit code, output and errors of this program with some words.

    Args:
        words: of its command line.
        patience: longest time that it may take [s]; then it is ended.
        late: the message in that case.

    Raises:
        ControllerError: it takes too long.
    """
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        *("-m", "hil_bench", *words),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        async with asyncio.timeout(patience):
            output, errors = await process.communicate()
    except TimeoutError:
        raise ControllerError(late) from None
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    return process.returncode, output, errors


# Record as a test: what was clicked becomes a scenario file, and runs at once.

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
    """Write a scenario to its path; errors are those of `write_named`."""
    write_named(scenario.path, to_toml(scenario), replaces=replaces)


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


# A run of a campaign played again for a page: its verdicts, and the picture of the worst one.

_KEY = re.compile(r"[0-9a-f]{4,64}")
_OPTION = re.compile(r"--(runs|sampler|seed|set)=.+", re.DOTALL)
_MOST_PICTURE = 1 << 24
_DECIDED = {0, 1, 6}  # exit codes of a run that came to an end


async def replay_run(again: object, key: str) -> dict[str, object]:
    """Play a run again in a process of its own.

    Args:
        again: words of the campaign's command, as the feed says them: checked here.
        key: of the run.

    Returns:
        The ``run`` as ``campaign --run --json`` has it, and the ``picture`` as a data URI; empty
        where there is none.

    Raises:
        ConfigError: the key or the words are wrong, or it cannot be played.
    """
    words = _checked(again)
    if not _KEY.fullmatch(key):
        raise ConfigError(f"run {key[:80]!a}: give the key of a run, hexadecimal digits")
    with scratch_folder() as folder:
        picture = folder / "run.svg"
        options = (f"--run={key}", f"--picture={picture}", "--json")
        code, output, errors = await _play([*words, *options])
        if code not in _DECIDED:
            text = errors[-_MOST_OUTPUT:].decode(errors="replace").strip()
            raise ConfigError(text or f"run {key}: ended with exit code {code}")
        return {"run": json.loads(output)["run"], "picture": _data_uri(picture)}


def _checked(again: object) -> list[str]:
    """Return the words of a campaign's command.

    Raises:
        ConfigError: they are others; nothing else is ever started.
    """
    if (
        not isinstance(again, list)
        or len(again) < 2
        or not all(isinstance(word, str) for word in again)
        or again[0] != "campaign"
        or again[1].startswith("-")
        or not all(_OPTION.fullmatch(word) for word in again[2:])
    ):
        raise ConfigError("replay: what runs here is no campaign; repeat it in a shell")
    return again


async def _play(words: list[str]) -> tuple[int | None, bytes, bytes]:
    return await run_words(words, _PATIENCE, f"the run is not done after {_PATIENCE:g} s; ended")


def _data_uri(picture: Path) -> str:
    if not picture.exists() or picture.stat().st_size > _MOST_PICTURE:
        return ""
    return f"data:image/svg+xml;base64,{base64.b64encode(picture.read_bytes()).decode()}"


# Export of the scope's signals as measured data: MF4, written as recordings are.

MOST_BYTES = 1 << 26
"""Longest request [byte]: two minutes of 60 channels at 1 kHz."""

_MOST_CHANNELS = 1000
_MOST_NAME = 200
_WRONG = "mf4: give a line of JSON with comment and channels, then rows of float64"


def make_mf4(body: bytes) -> bytes:
    """Return an MF4 file of the rows that a page holds.

    Args:
        body: a line of JSON, ``{"comment": "...", "channels": [["axis1.P_A", "Pa"]]}``, and behind
            it rows of float64, little-endian: the time [s], then a value a channel in its unit.

    Raises:
        ConfigError: it is something else.
    """
    head, _, rows = body.partition(b"\n")
    try:
        content = json.loads(head)
        comment, given = str(content["comment"]), content["channels"]
        channels = [Channel(_name(name), _name(unit)) for name, unit in given]
    except (ValueError, TypeError, KeyError, RecursionError):
        raise ConfigError(_WRONG) from None
    names = {TIME.name, *(channel.name for channel in channels)}
    if len(names) != 1 + len(channels) or len(channels) > _MOST_CHANNELS:
        raise ConfigError(f"mf4: give up to {_MOST_CHANNELS} channels, each with another name")
    dtype = recording_dtype((TIME, *channels))
    if len(rows) % dtype.itemsize:
        raise ConfigError(f"{_WRONG}, {1 + len(channels)} values each")
    with scratch_folder() as folder:
        path = folder / "scope.mf4"
        file = MdfFile(path, (TIME, *channels), comment=comment)
        file.write_rows(np.frombuffer(rows, dtype="<f8").astype(np.float64).view(dtype))
        file.flush(durable=False)
        file.close()
        return path.read_bytes()


def _name(text: object) -> str:
    """Return a name or a unit.

    Raises:
        ValueError: it cannot be one.
    """
    if not isinstance(text, str) or len(text) > _MOST_NAME or not text.isprintable():
        raise ValueError
    return text
