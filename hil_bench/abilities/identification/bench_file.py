"""The `bench.toml` of an identified machine: the user's own file with another table of the axis."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from hil_bench.abilities.identification.identify import Estimate, Identification
from hil_bench.abilities.identification.ladder import ALIASES
from hil_bench.abilities.identification.machine import DEAD, DELAY, DROOP, LAG
from hil_bench.abilities.scenario.writing import toml_value
from hil_bench.bench.configuration import BenchConfig
from hil_bench.config.settings import Origin, Setting
from hil_bench.plants.hydraulic_cylinder.keys import DATA_SHEET_KEYS

_HEADER = re.compile(r"^\s*\[\[?\s*([^\]]+?)\s*\]?\]\s*(#.*)?$")
_DATA_SHEET = {key.name for key in DATA_SHEET_KEYS}
_OF = {**ALIASES, "relief_gradient_l_min_bar": DROOP}
"""The unknown behind a key that has another name."""


def write_bench(
    found: Identification, config: BenchConfig, source: str, said: Sequence[str]
) -> str:
    """Return a `bench.toml` with the machine that was found.

    Args:
        found: the machine.
        config: as it was read; its file's other tables stay as they are.
        source: names of the recordings.
        said: of its errors of prediction, lines.
    """
    name = found.record.axis
    text = "" if config.path is None else Path(config.path).read_text(encoding="utf-8")
    head = [
        f"# The axis {name} is as hil-bench identify found it from {source!r}.",
        *(f"# {line}" for line in said),
    ]
    kept = _without_table(text, name)
    table = "\n".join([f"[plant.{name}]", *_lines(found, config.settings, source)])
    parts = ["\n".join(head), kept.strip("\n"), table]
    return "\n\n".join(part for part in parts if part) + "\n"


def _without_table(text: str, axis: str) -> str:
    """Return the text of a file without the table of an axis."""
    kept, is_ours = [], False
    for line in text.splitlines():
        header = _HEADER.match(line)
        if header:
            parts = [part.strip().strip("\"'") for part in header[1].split(".")]
            is_ours = parts[:2] == ["plant", axis]
        if not is_ours:
            kept.append(line)
    return "\n".join(kept)


def _lines(found: Identification, settings: Sequence[Setting], source: str) -> list[str]:
    """Return the keys of the axis: those that were found, then those that were given."""
    keys = found.keys
    estimates = {one.name: one for one in found.estimates}
    lines = [
        f"{key} = {_toml(value)}  # {_origin(key, estimates, source)}"
        for key, value in keys.items()
    ]
    for setting in settings:
        key = setting.key.name
        if setting.table != f"plant.{found.record.axis}" or key in keys or key in _DATA_SHEET:
            continue
        if setting.origin is not Origin.DEFAULT and setting.value is not None:
            reason = f"  # {setting.reason}" if setting.reason else ""
            lines.append(f"{key} = {_toml(setting.value)}{reason}")
    for name in (DELAY, LAG):
        if name in estimates:
            one = estimates[name]
            lines.append(f"# {name} = {one.value:.4g}: of the sensors, for chain.delay_ms or so")
    return lines


def _origin(key: str, estimates: Mapping[str, Estimate], source: str) -> str:
    name = key if key in estimates else _OF.get(key, "")
    one = estimates.get(name)
    if one is None:
        return "follows from those that were identified"
    if not one.is_told:
        return f"hardly identifiable from {source}, +- {one.deviation:.2g}"
    unit = " of its dead part" if name in DEAD else ""
    return f"identified from {source}, +- {one.deviation:.2g}{unit}"


def _toml(value: object) -> str:
    """Return a value of a table as TOML, numbers with seven digits."""
    if isinstance(value, float):
        return f"{value:.7g}"
    return toml_value(str(value) if isinstance(value, Path) else value)
