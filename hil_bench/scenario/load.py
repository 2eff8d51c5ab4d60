"""Loading a scenario: `.scenario.toml`, or the same as CSV."""

import os
from pathlib import Path

from hil_bench.config.document import read_document
from hil_bench.scenario.csv_form import read_csv_document
from hil_bench.scenario.places import LocatedProblems, find_spots
from hil_bench.scenario.reading import read_scenario
from hil_bench.scenario.records import Scenario


def load_scenario(path: str | os.PathLike[str]) -> Scenario:
    """Return the scenario of a file, by its suffix CSV or TOML.

    Whatever is wrong comes as one `ConfigError`, a line a problem: ``file:line:column: key: what
    is wrong; what would be right``. The expectations are parsed by `compile_expectations`, which
    knows the signals.
    """
    file = Path(path)
    if file.suffix.lower() == ".csv":
        document, spots = read_csv_document(file)
    else:
        document = read_document(file)
        spots = find_spots(file.read_text(encoding="utf-8"))
    return read_scenario(file, document, LocatedProblems(str(file), spots))
