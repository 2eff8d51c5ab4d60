"""Loading a scenario: `.scenario.toml`, or the same as CSV."""

import os
from pathlib import Path

from hil_bench.abilities.scenario.csv_form import read_csv_document
from hil_bench.abilities.scenario.places import LocatedProblems, find_spots
from hil_bench.abilities.scenario.reading import read_requirements, read_scenario
from hil_bench.abilities.scenario.records import RequirementsFile, Scenario
from hil_bench.config.document import Document, Sort, read_document


def load_scenario(path: str | os.PathLike[str]) -> Scenario:
    """Return the scenario of a file, by its suffix CSV or TOML.

    Whatever is wrong comes as one `ConfigError`, a line a problem: ``file:line:column: key: what
    is wrong; what would be right``. The expectations are parsed by `compile_expectations`, which
    knows the signals.
    """
    file = Path(path)
    document, problems = _read(file)
    return read_scenario(file, document, problems)


def load_requirements(path: str | os.PathLike[str]) -> RequirementsFile:
    """Return the requirements of a file.

    The file is a scenario, or holds nothing but ``duration_s``, ``[[expect]]`` and
    ``[parameters]``.
    """
    document, problems = _read(Path(path))
    return read_requirements(document, problems)


def _read(file: Path) -> tuple[Document, LocatedProblems]:
    if file.suffix.lower() == ".csv":
        document, spots = read_csv_document(file)
    else:
        document = read_document(file, Sort.SCENARIO)
        spots = find_spots(file.read_text(encoding="utf-8-sig"))
    return document, LocatedProblems(str(file), spots)
