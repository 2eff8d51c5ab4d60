"""A failure as files: a scenario, and a test of ten lines that plays it."""

import os
import re
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from hil_bench.abilities.campaign.search.records import Method
from hil_bench.abilities.campaign.search.shrink import Shrunk, Target
from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.records import Scenario, SetStep
from hil_bench.abilities.scenario.writing import to_toml
from hil_bench.errors import about_file, whole_file

_TEST = '''\
"""{text}"""

from pathlib import Path

from hil_bench.abilities.scenario.load import load_scenario
from hil_bench.abilities.scenario.run import play, prepare


def test_{name}():
    scenario = load_scenario(Path(__file__).with_name("{file}"))
    for found in play(prepare(scenario)).findings:
        assert found.judgement.outcome == "passed", found.judgement
'''


class Files(NamedTuple):
    """The files written.

    Attributes:
        scenario: plays the failure.
        test: does so under pytest.
    """

    scenario: Path
    test: Path


def write_failure(
    shrunk: Shrunk, target: Target, folder: Path, found_by: tuple[Method, int]
) -> Files:
    """Write a failure to files; what cannot be written is a `ConfigError`.

    Args:
        shrunk: the failure.
        target: what fails.
        folder: where to.
        found_by: the method that found it, and the number of its run.
    """
    source = shrunk.scenario
    stem = source.path.name.split(".")[0]
    name = re.sub(r"\W+", "_", f"{stem}_{target.requirement or 'crash'}").lower()
    files = Files(folder / f"{name}.scenario.toml", folder / f"test_{name}.py")
    what = f"{target.requirement} fails" if target.requirement else "The run does not end well"
    method, number = found_by
    text = f"{what}: found by hil-bench falsify in {source.path.name}, run {number} of {method}."
    with about_file(folder):
        folder.mkdir(parents=True, exist_ok=True)
        content = to_toml(_moved(source, folder))
        test = _TEST.format(text=text, name=name, file=files.scenario.name)
        with whole_file(files.scenario) as scenario, whole_file(files.test) as of_pytest:
            scenario.write_text(f"# {text}\n{content}", encoding="utf-8")
            of_pytest.write_text(test, encoding="utf-8")
    return files


def load_failure(files: Files) -> Scenario:
    """Return the scenario that was written."""
    return load_scenario(files.scenario)


def _moved(scenario: Scenario, folder: Path) -> Scenario:
    """Return a scenario whose files are named as seen from another folder."""

    def seen(name: str) -> str:
        return os.path.relpath(scenario.path.parent / name, folder)

    steps = tuple(
        replace(each, table=seen(each.table)) if isinstance(each, SetStep) and each.table else each
        for each in scenario.steps
    )
    title = f"{scenario.title}: a failure"
    bench = seen(scenario.bench) if scenario.bench else None
    ids = tuple(each.id for each in scenario.expectations)
    controller = scenario.controller
    if controller is not None and controller.table:
        of_files = seen(str(controller.table.get("folder", ".")))
        controller = replace(controller, table={**controller.table, "folder": of_files})
    moved = replace(scenario, title=title, bench=bench, steps=steps, controller=controller)
    return replace(moved, requirement_ids=ids)
