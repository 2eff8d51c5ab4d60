"""The identity of a run as digests: program, bench, scenario, firmware, parameters, seed.

No digest knows where a file lies, so that the same run has the same key on every machine.
"""

import hashlib
import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import hil_bench
from hil_bench.abilities.campaign.sampling import Point
from hil_bench.abilities.controllers.kinds import files_of
from hil_bench.abilities.scenario.records import Controller, Scenario
from hil_bench.bench.configuration import BenchConfig
from hil_bench.errors import ConfigError

_SOURCES = {".py", ".lark", ".eds", ".toml"}
_LENGTH = 32  # hexadecimal digits of a digest: 128 bits
_LEFT_OUT = {
    "path",
    "settings",
    "realtime",
    "sensor_units",
}  # of a bench: they change nothing in virtual time


@cache
def program_identity() -> str:
    """Return version and digest of the code that runs, as in ``0.1.0+5f2c9a01``."""
    digest = hashlib.sha256()
    for name in ("hil_bench", "hil_drivers", "device_profiles"):
        spec = find_spec(name)  # as text: who runs campaigns needs no driver
        root = Path(str(spec.origin if spec else "")).parent
        for path in sorted(each for each in root.rglob("*") if each.suffix in _SOURCES):
            digest.update(f"{root.name}/{path.relative_to(root)}".encode())
            digest.update(path.read_bytes())
    return f"{hil_bench.__version__}+{digest.hexdigest()[:8]}"


def case_digest(scenario: Scenario, config: BenchConfig, firmware: str) -> str:
    """Return the digest of all that decides what runs of a scenario find.

    Args:
        scenario: without regard to its parameters and its bench.
        config: its bench, as it is without tolerances.
        firmware: the digest of the firmware's files; empty for none.
    """
    plain = replace(scenario, parameters=(), bench=None, title="", requirement_ids=())
    return _digest([program_identity(), _plain(plain), _plain(config), firmware])


def run_key(case: str, parameters: Point, tolerances: Point, seed: int | None) -> str:
    """Return the key of a run.

    Args:
        case: the digest of its case.
        parameters: each in its own unit.
        tolerances: keys of the bench with their values.
        seed: of the bench; None for the bench's own.
    """
    return _digest([case, sorted(parameters.items()), sorted(tolerances.items()), seed])


def firmware_digest(words: Sequence[str]) -> str:
    """Return the digest of the files of a command line: the program, and files it names.

    Args:
        words: the command line; none gives an empty text.

    Raises:
        ConfigError: there is no such program.
    """
    if not words:
        return ""
    program = shutil.which(words[0])
    if program is None:
        raise ConfigError(f"{words[0]}: is no program that can be run; build it first")
    files = [Path(program), *(Path(word) for word in words[1:])]
    digests = [file_digest(each) if each.is_file() else str(each) for each in files]
    return _digest(digests)


def controller_digest(controller: Controller | None, folder: Path) -> str:
    """Return the digest of the files of a scenario's controller; empty for none.

    Args:
        controller: of the scenario.
        folder: of the scenario's file, from which a kind's paths count.
    """
    if controller is None or controller.example:
        return ""
    if controller.firmware:
        return firmware_digest(controller.firmware)
    place = folder / str(controller.table.get("folder", "."))
    return _digest([file_digest(each) for each in files_of(controller.table, place)])


def file_digest(path: Path) -> str:
    """Return the digest of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:_LENGTH]


def _digest(value: object) -> str:
    text = json.dumps(value, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()[:_LENGTH]


def _plain(value: object) -> object:
    """Convert a value to one that JSON can hold; a file becomes the digest of its content."""
    plain: object
    match value:
        case Enum():
            plain = str(value.value)
        case None | bool() | str() | int():
            plain = value
        case float():
            plain = repr(value)
        case Path():
            plain = file_digest(value) if value.is_file() else value.name
        case Mapping():
            plain = [[_plain(key), _plain(each)] for key, each in value.items()]
        case list() | tuple():
            plain = [_plain(each) for each in value]
        case set() | frozenset():
            plain = sorted(json.dumps(_plain(each)) for each in value)
        case np.ndarray():
            plain = [repr(each) for each in value.ravel().tolist()]
        case _ if is_dataclass(value):
            left_out = _LEFT_OUT if isinstance(value, BenchConfig) else set()
            named = (each.name for each in fields(value) if each.compare)
            plain = [[name, _plain(getattr(value, name))] for name in named if name not in left_out]
        case _:
            kind = type(value)
            plain = f"{kind.__module__}.{kind.__qualname__} {getattr(value, 'name', '')}"
    return plain
