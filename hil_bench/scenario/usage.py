"""Which parameters of a scenario do nothing: most often a name that is misspelt."""

import re
from collections.abc import Iterator
from dataclasses import fields

from hil_bench.config.values import find_nearest
from hil_bench.scenario.controllers import ControllerSettings
from hil_bench.scenario.records import FaultStep, Reference, Scenario

_WORD = re.compile(r"\w+")


def unused_parameters(scenario: Scenario) -> Iterator[str]:
    """Yield a line for each parameter that no step, no expectation and no controller takes."""
    used = {*_names_in_steps(scenario)}
    for each in scenario.expectations:
        used.update(_WORD.findall(each.that))
    own: list[str] = []
    if scenario.controller is not None:
        for word in scenario.controller.firmware:
            used.update(_WORD.findall(word))
        if scenario.controller.example:
            own = [field.name for field in fields(ControllerSettings)]
    for parameter in scenario.parameters:
        if parameter.name not in {*used, *own}:
            right = "name it in a step, an expectation or the firmware's words"
            if own:
                right = f"the nearest of the controller's is {find_nearest(parameter.name, own)}"
            yield f"{scenario.path}: parameters.{parameter.name}: does nothing; {right}"


def _names_in_steps(scenario: Scenario) -> Iterator[str]:
    for step in scenario.steps:
        values = [getattr(step, field.name) for field in fields(step)]
        if isinstance(step, FaultStep):
            values += [value for _, value in step.values]
        yield from (value.name for value in values if isinstance(value, Reference))
