"""An FMU as a kind of plant: its quantities are those that a file binds."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from hil_bench.config.settings import Problems, Settings
from hil_bench.errors import ConfigError
from hil_bench.plants.fmu.configuration import (
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
from hil_bench.plants.fmu.description import FmuDescription, read_fmu
from hil_bench.plants.fmu.keys import FMU_KEYS
from hil_bench.plants.fmu.plant import FmuPlant
from hil_bench.plants.hydraulic_cylinder.quantities import SPOOL_POSITION, SPOOL_SETPOINT
from hil_bench.plants.kind import PlantKind
from hil_bench.plants.quantity import Quantity
from hil_bench.units import MILLIMETRE


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
