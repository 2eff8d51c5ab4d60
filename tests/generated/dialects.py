"""The sorts of files, by dialect, and the verbs that read each."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Final, NamedTuple

from generated import seeds

ARGUMENTS: Final = "arguments"
BYTES: Final = "bytes"


class Dialect(NamedTuple):
    """A sort of file.

    Attributes:
        name: of the sort.
        suffix: of its files.
        verbs: words of each verb that reads it; ``{}`` is the file, ``{0}`` its first line.
        seeds: sound files: their folder below the repository, and their text.
        edit: how it is edited: a "document" of TOML, "cells", "lines", `BYTES`, or `ARGUMENTS`,
            lines that are no file but words of the command line, or answers to its questions.
        plays: whether a verb plays it, which is kept short.
    """

    name: str
    suffix: str
    verbs: tuple[tuple[str, ...], ...]
    seeds: tuple[tuple[str, str | bytes], ...]
    edit: str = "document"
    plays: bool = True


def verbs_of(*lines: str) -> tuple[tuple[str, ...], ...]:
    """Return the words of lines."""
    return tuple(tuple(line.split()) for line in lines)


_MAP: Final = seeds.REPOSITORY / "device_profiles/registers/pressure_404.toml"
_CAMPAIGNS: Final = (
    seeds.CAMPAIGN,
    *(
        seeds.CAMPAIGN.replace('"grid"', f'"{name}"').replace("range", keys)
        for name, keys in (("sobol", "log_range"), ("monte_carlo", "normal"))
    ),
    seeds.CAMPAIGN.replace("range = [6.0, 9.0]", "triangular = [6.0, 7, 9.0]"),
    seeds.CAMPAIGN.replace("range = [6.0, 9.0]", "values = [6.0, 9.0]"),
)
_LONG: Final = (
    *seeds.examples("examples/scenarios", "*.scenario.toml"),
    *seeds.examples("examples/machines", "*.scenario.toml"),
)
_SHEETS: Final = (seeds.SHEET, seeds.SHEET.replace(",", ";"))
_RESULTS: Final = (json.dumps(seeds.RESULTS, indent=1), seeds.JUNIT)


def _verbs(name: str) -> tuple[tuple[str, ...], ...]:
    """Return the words of each verb that reads a dialect, a line each in ``verbs.txt``."""
    text = Path(__file__).with_name("verbs.txt").read_text(encoding="utf-8")
    return verbs_of(*text.partition(f"==== {name}\n")[2].partition("\n\n")[0].splitlines())


def _dialect(
    name: str, suffix: str, texts: Iterable[str | bytes], edit: str = "document"
) -> Dialect:
    """Return a dialect whose seeds are texts in the folder of examples."""
    return Dialect(name, suffix, _verbs(name), tuple(("examples", text) for text in texts), edit)


DIALECTS: Final = (
    Dialect("bench", ".toml", _verbs("bench"), tuple(seeds.benches())),
    Dialect("network", ".toml", _verbs("network"), (*seeds.examples("examples", "network.*"),)),
    _dialect("plan", ".toml", [seeds.PLAN]),
    _dialect("scenario", ".scenario.toml", [seeds.SCENARIO, seeds.STEPS]),
    Dialect(
        *("scenario of a minute", ".scenario.toml", _verbs("scenario of a minute"), _LONG),
        plays=False,
    ),
    _dialect("campaign", ".toml", _CAMPAIGNS),
    _dialect("set", "", ["load_n=10", "limit_bar=200"], ARGUMENTS),
    _dialect("requirements", ".toml", [seeds.REQUIREMENTS]),
    _dialect("register map", ".toml", [seeds.REGISTER_MAP, _MAP.read_text()]),
    _dialect("columns", ".toml", [seeds.COLUMNS]),
    _dialect("map", "", seeds.MAPS, ARGUMENTS),
    _dialect("answers", "", seeds.ANSWERS, ARGUMENTS),
    _dialect("shell", "", ["bash"], ARGUMENTS),
    _dialect("scenario sheet", ".csv", _SHEETS, "cells"),
    _dialect("course", ".csv", [seeds.COURSE], "cells"),
    _dialect("recording", ".csv", [seeds.recording()], "cells"),
    _dialect("measured table", ".csv", [seeds.measured()], "cells"),
    _dialect("EDS", ".eds", [text for _, text in seeds.EDS], "lines"),
    Dialect("DBC", ".dbc", _verbs("DBC"), (*seeds.examples("examples", "*.dbc"),), "lines"),
    _dialect("log", ".log", [seeds.LINES], "lines"),
    _dialect("ASC log", ".asc", [seeds.ASC], "lines"),
    _dialect("results", "", _RESULTS, "lines"),
)
"""Every dialect that a verb reads."""

COSTLY: Final = {"evidence", "analyse", "identify", "export-fmu", "commission", "falsify"}
"""Verbs that take over a second a file; they are played where they are named."""

SLOWER: Final = {"boot", "campaign", "conformance", "plot", "shadow"}
"""Verbs that take over 50 ms a file, and have fewer files."""
