"""An FMU as a kind of plant: its quantities are those that a file binds."""

import math
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from hil_bench.config.settings import Problems, Settings
from hil_bench.errors import ConfigError, ParameterError
from hil_bench.plants.fmu.child import Child
from hil_bench.plants.fmu.configuration import (
    FMU_KEYS,
    FULL_SCALE,
    Bound,
    FmuBinding,
    FmuConfig,
    bind,
    check_step,
    find_variable,
    parameters_of,
    quantities_of,
)
from hil_bench.plants.fmu.description import FmuDescription, read_fmu, unpack
from hil_bench.plants.fmu.slave import Instance, Setup, SlaveError
from hil_bench.plants.hydraulic_cylinder.quantities import SPOOL_POSITION, SPOOL_SETPOINT
from hil_bench.plants.plant import PlantKind, Quantity
from hil_bench.scratch import ScratchFolder
from hil_bench.units import MILLIMETRE

# An FMU as a plant of a bench.


class FmuPlant:
    """One instance of an FMU, moved on by its own solver, a communication step a plant step.

    Args:
        axis: its record.
        dt: communication step [s].

    Raises:
        ParameterError: the FMU cannot be started.
    """

    def __init__(self, axis: FmuConfig, dt: float) -> None:
        self._axis, self._dt, self._steps = axis, dt, 0
        self._names = [quantity.name for quantity in axis.kind.outputs]
        self._factors = [binding.factor for binding in axis.outputs]
        self._given = [0.0, *(binding.start for binding in axis.inputs.values())]
        self._places = {name: place for place, name in enumerate(axis.inputs, 1)}
        scratch = ScratchFolder()
        weakref.finalize(self, scratch.remove)
        folder = scratch.path
        unpack(axis.path, folder)
        setup = Setup(
            version=axis.description.version,
            token=axis.description.token,
            identifier=axis.description.identifier,
            folder=str(folder),
            library=str(folder / axis.description.library),
            name=axis.name,
            step=dt,
            parameters=axis.parameters,
            written=[axis.command, *(binding.reference for binding in axis.inputs.values())],
            given=self._given,
            read=[binding.reference for binding in axis.outputs],
        )
        try:
            self._instance = instance = Child(setup) if axis.own_process else Instance(setup)
            weakref.finalize(self, instance.end)  # before its folder goes: the last is called first
            self._output = self._look(instance.values, 0.0)
        except SlaveError as error:
            raise ParameterError(f"plant.{axis.name}: {axis.path}: {error}") from None

    @property
    def output(self) -> tuple[float, ...]:
        """The present outputs in SI."""
        return self._output

    def drive(self, command: float, steps: int) -> tuple[float, ...]:
        """Move on under a command, as a share of `FULL_SCALE`.

        Raises:
            ParameterError: a step has failed, or the FMU shows what is no number.
        """
        self._given[0] = command / FULL_SCALE * self._axis.full_command
        try:
            values = self._instance.go_on(self._given, steps)
            self._steps += steps
            self._output = self._look(values, command)
        except SlaveError as error:
            time = self._steps * self._dt
            where = f"plant.{self._axis.name}: {self._axis.path}"
            raise ParameterError(f"{where}: at {time:.4g} s: {error}") from None
        return self._output

    def go_to(self, values: Mapping[str, float]) -> None:
        """Stay where it is: nobody but its own solver moves an FMU."""

    def influence(self, name: str, value: float | None) -> None:
        """Set an input [SI]; let go, it has its start value."""
        binding = self._axis.inputs[name]
        given = binding.start if value is None else value / binding.factor
        self._given[self._places[name]] = given

    def _look(self, values: Sequence[float], command: float) -> tuple[float, ...]:
        """Return outputs in SI, and the command where no variable follows it.

        Raises:
            SlaveError: one is no number.
        """
        seen = [value * factor for value, factor in zip(values, self._factors, strict=True)]
        if not all(map(math.isfinite, seen)):
            for name, value in zip(self._names, seen, strict=False):
                if not math.isfinite(value):
                    raise SlaveError(f"{name} is {value}; a finite number is right")
        return (*seen, command) if self._axis.echoes_command else tuple(seen)


# An FMU as a kind of plant: its quantities are those that a file binds.


class FmuKind(PlantKind[FmuConfig]):
    """Any FMU for co-simulation."""

    name = "fmu"
    keys = FMU_KEYS
    quantities: tuple[Quantity, ...] = (SPOOL_POSITION._replace(output=0), SPOOL_SETPOINT)
    command_unit = MILLIMETRE

    def specialise(self, settings: Settings, folder: Path, problems: Problems) -> "FmuKind | None":
        """Return the kind with the quantities that the variables of an FMU are bound to."""
        key = "file"
        try:
            path = folder / settings["file"].value
            description = read_fmu(path)
            key = "outputs"
            told: Mapping[str, Mapping[str, str]] = settings[key].value
            outputs = {name: bind(description, each, "output") for name, each in told.items()}
            key = "inputs"
            told = settings[key].value or {}
            inputs = {name: bind(description, each, "input") for name, each in told.items()}
            key = "command"
            command = find_variable(description, settings[key].value, "input").reference
            key = "parameters"
            parameters = parameters_of(settings, description)
        except ConfigError as error:
            problems.add(problems.place(settings[key].table, key), error)
            return None
        return BoundFmu(path, description, outputs, inputs, command, parameters)

    def configure(
        self, name: str, settings: Settings, step_us: int, problems: Problems
    ) -> FmuConfig | None:
        """Return None: an FMU that is bound to nothing is no axis."""

    def build(
        self, axis: FmuConfig, dt: float, start: Mapping[str, float] | None = None
    ) -> FmuPlant:
        """Return an instance of the FMU, at its own start."""
        return FmuPlant(axis, dt)

    def full_scale(self, settings: Settings) -> float:
        """Return the spool position at 100 % [mm]."""
        return MILLIMETRE.from_si(FULL_SCALE)


class BoundFmu(FmuKind):
    """One FMU whose variables are bound.

    Args:
        path: of the FMU.
        description: what it says of itself.
        outputs: what is read of it, by name.
        inputs: what acts on it from outside, by name.
        command: value reference of the input that is commanded.
        parameters: value references with what is set before the start.
    """

    def __init__(
        self,
        path: Path,
        description: FmuDescription,
        outputs: Mapping[str, Bound],
        inputs: Mapping[str, Bound],
        command: int,
        parameters: tuple[tuple[int, float], ...],
    ) -> None:
        self.quantities = quantities_of(outputs)
        self._path, self._description, self._command = path, description, command
        self._outputs, self._inputs, self._parameters = outputs, inputs, parameters

    def configure(
        self, name: str, settings: Settings, step_us: int, problems: Problems
    ) -> FmuConfig | None:
        """Return the record of an axis; a step that the FMU does not take is noted."""
        check_step(name, self._description, step_us, problems)
        full = float(settings["full_command"].value)
        if not full:
            place = problems.place(settings["full_command"].table, "full_command")
            problems.add(place, "0 moves nothing; give the input's value at 100 %")
            return None
        outputs = tuple(
            FmuBinding(
                bound.variable.reference,
                FULL_SCALE / full if quantity == SPOOL_POSITION.name else bound.factor,
            )
            for quantity, bound in self._outputs.items()
        )
        return FmuConfig(
            name=name,
            kind=self,
            path=self._path,
            description=self._description,
            command=self._command,
            full_command=full,
            outputs=outputs,
            echoes_command=SPOOL_POSITION.name not in self._outputs,
            inputs={
                each: FmuBinding(
                    bound.variable.reference, bound.factor, bound.variable.start or 0.0
                )
                for each, bound in self._inputs.items()
            },
            limits_of_inputs={each: bound.span for each, bound in self._inputs.items()},
            units_of_inputs={each: bound.unit for each, bound in self._inputs.items()},
            parameters=self._parameters,
            spans={
                each: bound.span
                for each, bound in self._outputs.items()
                if None not in {bound.variable.low, bound.variable.high}
            },
            own_process=settings["own_process"].value,
        )


FMU: Final = FmuKind()
