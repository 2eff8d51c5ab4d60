"""The slave in an exported FMU: it runs the axes of the bench's file that lies beside it.

It is imported by the FMU alone, in a Python that has hil-bench.
"""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement

from pythonfmu import Fmi2Causality, Fmi2Variability, Real
from pythonfmu.default_experiment import DefaultExperiment

from hil_bench.abilities.common.together import axes_with, build_together
from hil_bench.abilities.fmu.export import find_inputs, prefixes
from hil_bench.bench.configuration import load_config
from hil_bench.plants.plant import AxisConfig, Plant

BENCH_FILE = "bench.toml"
"""Name of the bench's file among the resources."""


class AxisSlave:
    """The axes of a bench that has one, or one supply; inputs and outputs are quantities in SI.

    It is no subclass of PythonFMU's slave but has one: the class that PythonFMU makes instances of
    must be made anew with each, or the second one crashes.

    Args:
        slave: of PythonFMU.
    """

    def __init__(self, slave: Any) -> None:  # noqa: ANN401 - PythonFMU has no types
        config = load_config(Path(slave.resources) / BENCH_FILE)
        axes = axes_with(config, config.axes[0])
        group = build_together(config, axes)
        self._slave, self._dt, self._group = slave, config.dt, group
        self._full = [config.full_scale(axis) for axis in axes]
        self._acting = find_inputs(config, axes)
        self._units = {each.name: each.unit for each in self._acting}
        starts = [(prefix + axis.kind.command.name, 0.0) for axis, prefix in _named(axes)]
        self._commands = [name for name, _ in starts]
        self._inputs = dict([*starts, *((each.name, each.start) for each in self._acting)])
        self._acted = dict(self._inputs)
        kinds = " and ".join(dict.fromkeys(axis.kind.name for axis in axes))
        slave.modelName, slave.author = "Axis", "hil-bench"
        slave.description = f"{kinds}, moved on in steps of {config.step_ns // 1000} us"
        slave.default_experiment = DefaultExperiment(0.0, 1.0, config.tick_ns * 1e-9)
        for name, start in self._inputs.items():
            self._register(name, Fmi2Causality.input, self._reader(name), start=start)
        for plant, full, (axis, prefix) in zip(group.plants, self._full, _named(axes), strict=True):
            for quantity in axis.kind.outputs:
                scale = 1.0 / full if quantity.is_share else 1.0
                reader = _shown(plant, quantity.output or 0, scale)
                self._units[prefix + quantity.name] = quantity.unit
                self._register(prefix + quantity.name, Fmi2Causality.output, reader)

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

    def step(self, step_size: float) -> bool:
        """Move the plant on; a step that is no multiple of the plant's own is refused."""
        steps = round(step_size / self._dt)
        if steps < 1 or abs(steps * self._dt - step_size) > 1e-9:
            return False
        for each in self._acting:
            value = self._inputs[each.name]
            if value != self._acted[each.name]:
                self._acted[each.name] = value
                self._group.plants[each.axis].influence(each.influence, value)
        commands = [
            self._inputs[name] * full for name, full in zip(self._commands, self._full, strict=True)
        ]
        self._group.drive(commands, steps)
        return True


def _named(axes: list[AxisConfig]) -> Iterable[tuple[AxisConfig, str]]:
    return zip(axes, prefixes(axes), strict=True)


def _shown(plant: Plant, place: int, scale: float) -> Callable[[], float]:
    return lambda: float(plant.output[place]) * scale


def _spell(unit: str) -> str:
    """Return a unit as FMI spells it: ``m3/s`` for ``m³/s``, ``1`` for a number."""
    return "1" if unit == "-" else unit.replace("³", "3").replace(" ", ".")
