"""The kind `fmu`: an FMU for co-simulation whose variables are bound to the drivers' quantities."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from hil_bench.abilities.controllers.fmu.plan import Plan
from hil_bench.abilities.controllers.seam import Controller, ControllerKind, Surroundings
from hil_bench.config.settings import Key
from hil_bench.config.values import as_table, describe, number, text
from hil_bench.errors import ConfigError
from hil_bench.plants.fmu.configuration import bindings
from hil_bench.units import MILLISECOND

_QUANTITY: Final = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,63}(\.[A-Za-z][A-Za-z0-9_]{0,31})?")
_read_bindings = bindings(_QUANTITY, "AXIS.QUANTITY, or the name of a parameter, is right")


def bound_quantities(value: object) -> dict[str, dict[str, str]]:
    """Read variables by quantities; ``axis1.position = "x"`` needs no quotes in its key."""
    if not isinstance(value, dict):
        return _read_bindings(value)
    flat: dict[str, object] = {}
    for name, given in value.items():
        if isinstance(given, dict) and not given.keys() & {"variable", "unit"}:
            flat |= {f"{name}.{quantity}": each for quantity, each in given.items()}
        else:
            flat[name] = given
    return _read_bindings(flat)


def parameter_values(value: object) -> dict[str, str]:
    """Read numbers, or parameters of the scenario in braces, by the names of their variables.

    Raises:
        ConfigError: it is something else.
    """
    right = 'give VARIABLE = NUMBER, or VARIABLE = "{parameter}"'
    read = number()
    words = {}
    for name, given in as_table(value, right).items():
        is_name = isinstance(given, str) and re.fullmatch(r"\{\w+\}", given)
        try:
            words[name] = str(given) if is_name else repr(read(given))
        except ConfigError:
            raise ConfigError(f"{name} = {describe(given)} is no number; {right}") from None
    return words


class FmuKind(ControllerKind):
    """An FMU for co-simulation, FMI 2.0 or 3.0."""

    name = "fmu"
    summary = "an FMU for co-simulation on the drivers of the devices"
    is_native = True
    keys = (
        Key("file", text, example='"control.fmu"'),
        Key("period_ms", number(MILLISECOND, low=0.1, high=50.0), 2.0, MILLISECOND),
        Key("inputs", bound_quantities, {}),
        Key("outputs", bound_quantities, example='{ axis1.spool_setpoint = "u" }'),
        Key("parameters", parameter_values, {}),
    )

    def problems(self, settings: Mapping[str, Any], folder: Path) -> Sequence[str]:
        """Return the first fault of the FMU and its bindings."""
        try:
            Plan(settings, folder)
        except ConfigError as error:
            return [str(error)]
        return ()

    def build(self, settings: Mapping[str, Any], surroundings: Surroundings) -> Controller:
        """Return a controller that starts its FMU at its first `advance`."""
        from hil_bench.abilities.controllers.fmu.controller import (  # noqa: PLC0415 - canopen
            FmuControl,
        )
        from hil_bench.abilities.controllers.python.controller import (  # noqa: PLC0415 - canopen
            PythonController,
        )

        return PythonController(
            FmuControl(Plan(settings, surroundings.folder), surroundings), surroundings
        )


KIND = FmuKind()
