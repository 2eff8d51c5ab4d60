"""The FMU of a controller, and what of it is bound to quantities."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from hil_bench.config.values import quote
from hil_bench.errors import ConfigError
from hil_bench.plants.fmu.configuration import Bound, bind, find_variable, step_fault
from hil_bench.plants.fmu.description import FmuDescription, read_fmu


class Plan:
    """The FMU of a table, and what of it is bound.

    Args:
        settings: values of the table by key, in SI.
        folder: from which relative paths count.

    Attributes:
        path: of the FMU.
        description: what it says of itself.
        inputs: variables by the quantity or the parameter that they show.
        outputs: variables by the quantity that they command.
        parameters: value references of variables that are set before the start, each with a number
            or a parameter of the scenario in braces.
        period: of its cycle [s].

    Raises:
        ConfigError: it cannot be used so; the text begins with the key.
    """

    def __init__(self, settings: Mapping[str, Any], folder: Path) -> None:
        self.path = folder / settings["file"]
        self.period: float = settings["period_ms"]
        key = "file"
        try:
            self.description = read_fmu(self.path)
            key = "period_ms"
            _check_step(self.description, self.period)
            key = "inputs"
            self.inputs = self._bind(settings[key], "input")
            key = "outputs"
            self.outputs = self._bind(settings[key], "output")
            _check_quantities(self.outputs)
            key = "parameters"
            self.parameters = tuple(
                (find_variable(self.description, name, "parameter").reference, word)
                for name, word in settings[key].items()
            )
        except ConfigError as error:
            raise ConfigError(f"{key}: {error}") from error

    def _bind(self, told: Mapping[str, Mapping[str, str]], causality: str) -> dict[str, Bound]:
        bound = {name: bind(self.description, each, causality) for name, each in told.items()}
        taken: dict[int, str] = {}
        for name, each in bound.items():
            other = taken.setdefault(each.variable.reference, name)
            if other != name and causality == "input":
                raise ConfigError(
                    f"{other} and {name} are bound to one variable; give each its own"
                )
        return bound


def _check_quantities(names: Iterable[str]) -> None:
    """Check that these are quantities, and no parameters.

    Raises:
        ConfigError: one is not.
    """
    for name in names:
        if "." not in name:
            raise ConfigError(f"{quote(name)} is no quantity; write it as axis1.NAME")


def _check_step(description: FmuDescription, period: float) -> None:
    """Compare a cycle with the communication step that an FMU takes.

    Raises:
        ConfigError: they do not agree.
    """
    if fault := step_fault(description, period):
        wrong, right = fault
        raise ConfigError(f"{period * 1e3:.10g} ms {wrong}; {right * 1e3:.10g} ms is right")
