"""Which parameters of a scenario do nothing: most often a name that is misspelt."""

import re
from collections.abc import Iterator
from dataclasses import fields

from hil_bench.config.values import find_nearest
from hil_bench.scenario.controllers import ControllerSettings
from hil_bench.scenario.records import FaultStep, Reference, Scenario, SetStep

_WORD = re.compile(r"\w+")


def unused_parameters(scenario: Scenario) -> Iterator[str]:
    """Yield the names of the parameters that no step, no expectation and no controller takes."""
    used = {*_names_in_steps(scenario), *_settings(scenario)}
    for each in scenario.expectations:
        used.update(_WORD.findall(each.that))
    if scenario.controller is not None:
        for word in scenario.controller.firmware:
            used.update(_WORD.findall(word))
    yield from (each.name for each in scenario.parameters if each.name not in used)


def usage_problems(scenario: Scenario) -> Iterator[str]:
    """Yield a line for each parameter that nothing takes."""
    own = _settings(scenario)
    for name in unused_parameters(scenario):
        right = "name it in a step, an expectation or the firmware's words"
        if own:
            right = f"the nearest of the controller's is {find_nearest(name, own)}"
        yield f"{scenario.path}: parameters.{name}: does nothing; {right}"


def _settings(scenario: Scenario) -> list[str]:
    """Return what the example controller takes; nothing where another one controls."""
    if scenario.controller is None or not scenario.controller.example:
        return []
    return [field.name for field in fields(ControllerSettings)]


def _names_in_steps(scenario: Scenario) -> Iterator[str]:
    for step in scenario.steps:
        values = [getattr(step, field.name) for field in fields(step)]
        if isinstance(step, FaultStep):
            values += [value for _, value in step.values]
        if isinstance(step, SetStep):
            values += [value for _, value in step.points]
        yield from (value.name for value in values if isinstance(value, Reference))
