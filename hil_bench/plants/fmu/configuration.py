"""The table ``[plant.NAME]`` of an FMU: its variables bound to quantities."""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from hil_bench.config.settings import Key, Problems, Settings
from hil_bench.config.values import as_table, boolean, describe, find_nearest, number, quote, text
from hil_bench.errors import ConfigError
from hil_bench.plants.fmu.description import FmuDescription, FmuVariable
from hil_bench.plants.hydraulic_cylinder.quantities import QUANTITIES as QUANTITIES_OF_CYLINDERS
from hil_bench.plants.hydraulic_cylinder.quantities import SPOOL_POSITION, SPOOL_SETPOINT
from hil_bench.plants.plant import AxisConfig, Influence, Quantity
from hil_bench.plants.rotary.configuration import QUANTITIES as QUANTITIES_OF_MOTORS
from hil_bench.units import KILOGRAM, NEWTON, UNITS_OF, Unit

# The keys of a table ``[plant.NAME]`` with ``kind = "fmu"``; `docs/fmu.md` tells their meaning.


UNITS: Final = {
    **{unit.symbol: (symbol, unit) for symbol, units in UNITS_OF.items() for unit in units},
    "1": ("-", Unit("-", "")),
    **{unit.symbol: (unit.symbol, unit) for unit in (NEWTON, KILOGRAM)},
    "kN": ("N", Unit("kN", "_kn", 1e3)),
    "N.m": ("N m", Unit("N m", "_n_m")),
    "m3/s": ("m³/s", Unit("m³/s", "_m3_s")),
    "r/min": ("rad/s", UNITS_OF["rad/s"][-1]),
}
"""Units of an FMU's variables: the SI unit, and what one of them is; spelled as FMI does, too."""

_NAME: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,31}")

Bindings = dict[str, dict[str, str]]


def bindings(names: re.Pattern[str], right_name: str) -> Callable[[object], Bindings]:
    """Return a reader of variables by names, each with a unit where one is given.

    Args:
        names: those that are right.
        right_name: the same in words.
    """
    right = 'give NAME = "VARIABLE", or NAME = { variable = "VARIABLE", unit = "mm" }'

    def read(value: object) -> Bindings:
        table = as_table(value, right)
        for name in table:
            if not names.fullmatch(name):
                raise ConfigError(f"{describe(name)} cannot be a name; {right_name}")
        return {name: _variable(name, given, right) for name, given in table.items()}

    return read


def _variable(name: str, given: object, right: str) -> dict[str, str]:
    """Return a variable, and its unit where one is given.

    Raises:
        ConfigError: it is something else.
    """
    told = {"variable": given} if isinstance(given, str) else given
    if (
        not isinstance(told, dict)
        or told.keys() - {"variable", "unit"}
        or not all(isinstance(each, str) for each in told.values())
    ):
        raise ConfigError(f"{name} = {describe(given)} binds nothing; {right}")
    if "variable" not in told:
        raise ConfigError(f"{name} has no variable; {right}")
    if told.get("unit", "-") not in UNITS:
        nearest = find_nearest(told["unit"], list(UNITS))
        raise ConfigError(f"{name}: {describe(told['unit'])} is no known unit; {nearest} is")
    return dict(told)


_bound = bindings(_NAME, "give at most 32 letters, digits or _")


def _numbers(value: object) -> dict[str, float]:
    """Read numbers by the names of their variables."""
    read, table = number(), as_table(value, "give VARIABLE = NUMBER")
    return {name: read(given) for name, given in table.items()}


FMU_KEYS: Final = (
    Key("file", text, example='"axis.fmu"'),
    Key("command", text, example='"u"'),
    Key("full_command", number(low=-1e9, high=1e9), 1.0),
    Key("outputs", _bound, example='{ position = "x" }'),
    Key("inputs", _bound),
    Key("parameters", _numbers),
    Key("own_process", boolean, True),
)


FULL_SCALE: Final = 1e-3
"""The command of 100 %, as a spool's stroke, where no valve has another one [m]."""

_LARGEST = 1e15


class FmuBinding(NamedTuple):
    """A variable that is a quantity.

    Attributes:
        reference: value reference of the variable.
        factor: SI value of one of its unit.
        start: its value at the start, in its own unit.
    """

    reference: int
    factor: float
    start: float = 0.0


@dataclass(frozen=True, slots=True)
class FmuConfig(AxisConfig):
    """An FMU and what of it is bound.

    Attributes:
        path: of the FMU.
        description: what it says of itself.
        command: value reference of the input that is commanded.
        full_command: value of that input at 100 %.
        outputs: what is read of it, in the order of the kind's outputs.
        echoes_command: whether the last output is the command itself, for no variable follows it.
        inputs: by the names of the influences.
        limits_of_inputs: of the same, [SI].
        units_of_inputs: SI units of the same.
        parameters: value references with what is set before the start.
        spans: least and largest value of the outputs that declare them [SI].
        own_process: whether it runs in a process of its own.
    """

    path: Path
    description: FmuDescription
    command: int
    full_command: float
    outputs: tuple[FmuBinding, ...]
    echoes_command: bool
    inputs: Mapping[str, FmuBinding]
    limits_of_inputs: Mapping[str, tuple[float, float]]
    units_of_inputs: Mapping[str, str]
    parameters: tuple[tuple[int, float], ...]
    spans: Mapping[str, tuple[float, float]]
    own_process: bool

    @property
    def full_scale(self) -> float:
        """The command of 100 % [m]."""
        return FULL_SCALE

    @property
    def influences(self) -> tuple[Influence, ...]:
        """The bound inputs."""
        return tuple(
            Influence(
                name,
                self.units_of_inputs[name],
                *self.limits_of_inputs[name],
                binding.start * binding.factor,
            )
            for name, binding in self.inputs.items()
        )

    def limits(self, quantity: str) -> tuple[float, float]:
        """Return the least and the largest value that the FMU declares [SI]."""
        return self.spans.get(quantity, (-math.inf, math.inf))


class Bound(NamedTuple):
    """A variable with the unit that it is taken to be in.

    Attributes:
        variable: of the FMU.
        unit: symbol of the SI unit.
        factor: SI value of one of the variable's unit.
    """

    variable: FmuVariable
    unit: str
    factor: float

    @property
    def span(self) -> tuple[float, float]:
        """Its least and largest value [SI], as far as it declares them."""
        low = -_LARGEST if self.variable.low is None else self.variable.low * self.factor
        high = _LARGEST if self.variable.high is None else self.variable.high * self.factor
        return low, high


def find_variable(
    description: FmuDescription, name: str, causality: str, *, others: bool = False
) -> FmuVariable:
    """Return a real variable of an FMU.

    Args:
        description: of the FMU.
        name: of the variable.
        causality: that it must have, in words.
        others: whether any causality will do.

    Raises:
        ConfigError: there is none.
    """
    variable = description.variables.get(name)
    if variable is None:
        of_kind = [
            each for each, found in description.variables.items() if found.causality == causality
        ]
        known = of_kind or list(description.variables)
        right = (
            f"the nearest {causality} is {find_nearest(name, known)}" if known else "it has none"
        )
        raise ConfigError(f"{quote(name)} is no variable of {description.model}; {right}")
    if variable.causality != causality and not others:
        wrong = f"{quote(name)} is of causality {variable.causality}"
        raise ConfigError(f"{wrong}; {causality} is right")
    if not variable.is_real:
        raise ConfigError(f"{quote(name)} is no scalar Real or Float64; bind one that is")
    return variable


def bind(description: FmuDescription, told: Mapping[str, str], causality: str) -> Bound:
    """Return a variable that is bound, in the unit given or in its own.

    Raises:
        ConfigError: it cannot be bound so.
    """
    is_output = causality == "output"
    variable = find_variable(description, told["variable"], causality, others=is_output)
    if is_output and variable.causality not in {"output", "local"}:
        wrong = f"{quote(told['variable'])} is of causality {variable.causality}"
        raise ConfigError(f"{wrong}; output or local is right")
    name = told.get("unit", variable.unit)
    unit, own = UNITS.get(name, (name or "-", None))
    return Bound(variable, unit, 1.0 if own is None else own.factor)


def quantities_of(outputs: Mapping[str, Bound]) -> tuple[Quantity, ...]:
    """Return the quantities of an FMU's axis: its outputs, then the command and what follows it."""
    known = {
        (each.name, each.unit): each
        for each in (*QUANTITIES_OF_MOTORS, *QUANTITIES_OF_CYLINDERS)
        if each.output is not None
    }
    found: list[Quantity] = []
    for place, (name, bound) in enumerate(outputs.items()):
        usual = known.get((name, bound.unit), Quantity(name, bound.unit, place))
        found.append(usual._replace(output=place, is_recorded=True, tolerance=None, residual=None))
    if SPOOL_POSITION.name not in outputs:
        found.append(SPOOL_POSITION._replace(output=len(found), tolerance=None, residual=None))
    return (*found, SPOOL_SETPOINT)


def step_fault(description: FmuDescription, step: float) -> tuple[str, float] | None:
    """Return why an FMU does not take a communication step, and the right one; None if it does.

    Args:
        description: of the FMU.
        step: the communication step [s].
    """
    fixed = description.fixed_step
    if not fixed or fixed <= 0.0:
        return None
    parts = step / fixed
    is_multiple = parts > 0.5 and math.isclose(parts, round(parts), rel_tol=1e-6)
    if description.is_exact and not math.isclose(parts, 1.0, rel_tol=1e-6):
        return f"is not the step of {description.model}, which takes no other", fixed
    if not is_multiple:
        return f"is no multiple of the internal step of {description.model}", fixed
    return None


def check_step(name: str, description: FmuDescription, step_us: int, problems: Problems) -> None:
    """Note a communication step, ``bench.step_us``, that an FMU does not take."""
    if fault := step_fault(description, step_us * 1e-6):
        wrong, fixed = fault
        right = f"{'' if description.is_exact else 'a multiple of '}{fixed * 1e6:.10g}"
        place = problems.place("bench", "step_us")
        problems.add(place, f"{step_us} {wrong}; give {right} for plant.{name}")


def parameters_of(settings: Settings, description: FmuDescription) -> tuple[tuple[int, float], ...]:
    """Return value references and values of the parameters; `ConfigError` for other variables."""
    given: Mapping[str, float] = settings["parameters"].value or {}
    return tuple(
        (find_variable(description, name, "parameter").reference, value)
        for name, value in given.items()
    )
