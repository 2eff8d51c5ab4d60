"""An FMU as a plant of a bench."""

import math
import weakref
from collections.abc import Mapping, Sequence

from hil_bench.errors import ParameterError
from hil_bench.plants.fmu.archive import unpack
from hil_bench.plants.fmu.child import Child
from hil_bench.plants.fmu.configuration import FULL_SCALE, FmuConfig
from hil_bench.plants.fmu.slave import Instance, Setup, SlaveError
from hil_bench.scratch import ScratchFolder


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
