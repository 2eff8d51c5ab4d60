"""What runs in an exported FMU: the axis of the bench's file that lies beside it.

It is imported by the FMU alone, in a Python that has hil-bench.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement

from pythonfmu import Fmi2Causality, Fmi2Variability, Real
from pythonfmu.default_experiment import DefaultExperiment

from hil_bench.bench.configuration import load_config
from hil_bench.machine.fmu_export.inputs import input_starts

BENCH_FILE = "bench.toml"
"""Name of the bench's file among the resources."""


class AxisSlave:
    """The first axis of a bench; inputs and outputs are its quantities, in SI.

    It is no subclass of PythonFMU's slave but has one: the class that PythonFMU makes instances of
    must be made anew with each, or the second one crashes.

    Args:
        slave: of PythonFMU.
    """

    def __init__(self, slave: Any) -> None:  # noqa: ANN401 - PythonFMU has no types
        config = load_config(Path(slave.resources) / BENCH_FILE)
        axis = config.axes[0]
        kind = axis.kind
        self._slave, self._dt, self._full = slave, config.dt, config.full_scale(axis)
        self._plant = kind.build(axis, config.dt)
        self._units = {each.name: each.unit for each in kind.outputs}
        self._units |= {each.name: each.unit for each in axis.influences}
        self._command = kind.command.name
        self._inputs = {self._command: 0.0, **input_starts(axis)}
        self._acting = dict(self._inputs)
        slave.modelName, slave.author = "Axis", "hil-bench"
        slave.description = f"{kind.name}, moved on in steps of {config.step_ns // 1000} us"
        slave.default_experiment = DefaultExperiment(0.0, 1.0, config.tick_ns * 1e-9)
        for name, start in self._inputs.items():
            self._register(name, Fmi2Causality.input, self._reader(name), start=start)
        for quantity in kind.outputs:
            scale = 1.0 / self._full if quantity.is_share else 1.0
            reader = self._shown(quantity.output or 0, scale)
            self._register(quantity.name, Fmi2Causality.output, reader)

    def complete(self, root: Element) -> Element:
        """Return the description with the units and the initial unknowns that it lacks."""
        definitions = Element("UnitDefinitions")
        for unit in dict.fromkeys(map(_spell, self._units.values())):
            SubElement(definitions, "Unit", {"name": unit})
        root.insert(1, definitions)
        variables = root.findall("ModelVariables/ScalarVariable")
        unknowns = SubElement(root.findall("ModelStructure")[0], "InitialUnknowns")
        for number, variable in enumerate(variables, 1):
            name = variable.get("name", "")
            if name in self._units:
                variable[0].set("unit", _spell(self._units[name]))
            if variable.get("causality") == "output":
                SubElement(unknowns, "Unknown", {"index": str(number)})
        return root

    def _register(
        self,
        name: str,
        causality: Fmi2Causality,
        getter: Callable[[], float],
        start: float | None = None,
    ) -> None:
        setter = None if start is None else self._writer(name)
        self._slave.register_variable(
            Real(
                name,
                start=start,
                causality=causality,
                variability=Fmi2Variability.continuous,
                getter=getter,
                setter=setter,
            )
        )

    def _reader(self, name: str) -> Callable[[], float]:
        return lambda: self._inputs[name]

    def _writer(self, name: str) -> Callable[[float], None]:
        def write(value: float) -> None:
            self._inputs[name] = value

        return write

    def _shown(self, place: int, scale: float) -> Callable[[], float]:
        return lambda: float(self._plant.output[place]) * scale

    def step(self, step_size: float) -> bool:
        """Move the plant on; a step that is no multiple of the plant's own is refused."""
        steps = round(step_size / self._dt)
        if steps < 1 or abs(steps * self._dt - step_size) > 1e-9:
            return False
        for name, value in self._inputs.items():
            if name != self._command and value != self._acting[name]:
                self._acting[name] = value
                self._plant.influence(name, value)
        self._plant.drive(self._inputs[self._command] * self._full, steps)
        return True


def _spell(unit: str) -> str:
    """Return a unit as FMI spells it: ``m3/s`` for ``m³/s``, ``1`` for a number."""
    return "1" if unit == "-" else unit.replace("³", "3").replace(" ", ".")
