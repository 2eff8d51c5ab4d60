"""The export of an axis as an FMU, and its inputs."""

import importlib.util
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from hil_bench.abilities.common.files import scratch_folder, whole_file
from hil_bench.abilities.common.together import axes_with, find_supply
from hil_bench.bench.configuration import BenchConfig
from hil_bench.config.settings import Origin
from hil_bench.errors import (
    ConfigError,
    about_file,
)
from hil_bench.plants.hydraulic_cylinder.supply_group import Fed
from hil_bench.plants.plant import SUPPLY, AxisConfig

# The inputs of an FMU's axes from outside, with their neutral values.


class Acting(NamedTuple):
    """An input that acts on an axis.

    Attributes:
        name: in the FMU.
        influence: in the bench.
        axis: number of the axis in the FMU.
        unit: SI.
        start: value at the start.
    """

    name: str
    influence: str
    axis: int
    unit: str
    start: float


def prefixes(axes: list[AxisConfig]) -> list[str]:
    """Return the prefixes of each axis' names in an FMU: empty for a single axis."""
    return [""] if len(axes) == 1 else [f"{axis.name}." for axis in axes]


def find_inputs(config: BenchConfig, axes: list[AxisConfig]) -> list[Acting]:
    """Return the inputs that act on the axes of an FMU; those of a shared supply once.

    Raises:
        ConfigError: an axis is another plant than a cylinder or a motor.
    """
    supply = find_supply(config, axes[0])
    found: list[Acting] = []
    for number, (axis, prefix) in enumerate(zip(axes, prefixes(axes), strict=True)):
        if not isinstance(axis, Fed):
            right = "give an axis that is a hydraulic cylinder or a rotary"
            raise ConfigError(f"plant.{axis.name}: a {axis.kind.name} cannot be exported; {right}")
        for each in axis.influences:
            if each.name != SUPPLY:
                found.append(Acting(prefix + each.name, each.name, number, each.unit, 0.0))
            elif supply is None:
                start = axis.cylinder.parameters.P_S
                found.append(Acting(each.name, each.name, number, each.unit, start))
            elif number == 0:
                found.append(Acting(each.name, each.name, number, each.unit, supply.pressure))
    return found


# Writes an axis as an FMU, by PythonFMU, and checks it by FMPy.

_MODULE = "hil_bench_axis"
_SCRIPT = """\
from pythonfmu import Fmi2Slave

from hil_bench.abilities.fmu.axis_slave import AxisSlave


class Axis(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self._axis = AxisSlave(self)

    def to_xml(self, model_options={}):
        return self._axis.complete(super().to_xml(model_options))

    def do_step(self, current_time, step_size):
        return self._axis.step(step_size)
"""
_GIVEN = {Origin.FILE, Origin.ENVIRONMENT, Origin.COMMAND_LINE}


def export_axis(config: BenchConfig, axis: AxisConfig, path: Path) -> None:
    """Write an axis, with those that share its supply, as an FMU for co-simulation (FMI 2.0).

    Args:
        config: the bench.
        axis: one of its axes.
        path: the FMU.

    Raises:
        ConfigError: it cannot be exported, or the file not be written.
    """
    if importlib.util.find_spec("pythonfmu") is None or importlib.util.find_spec("fmpy") is None:
        right = "pip install 'hil-bench[fmu]' brings both"
        raise ConfigError(f"{path}: needs PythonFMU and FMPy, which are not installed; {right}")
    from pythonfmu.builder import FmuBuilder  # noqa: PLC0415 - an extra

    if path.suffix != ".fmu":
        raise ConfigError(f"{path}: is no name of an FMU; give one that ends in .fmu")
    find_inputs(config, axes_with(config, axis))  # refuses what is no axis of ours
    searched = list(sys.path)
    with (
        scratch_folder() as folder,
        about_file(path),
        whole_file(path) as file,
    ):
        file.touch()  # PythonFMU would make its folder
        script, bench = folder / f"{_MODULE}.py", folder / "bench.toml"
        script.write_text(_SCRIPT, encoding="utf-8")
        bench.write_text("\n".join(_bench_lines(config, axis)), encoding="utf-8")
        sys.path.insert(0, str(folder))
        try:
            FmuBuilder.build_FMU(script, file, [bench], needsExecutionTool="true")
        finally:
            sys.path[:] = searched
            sys.modules.pop(_MODULE, None)


def validate(path: Path) -> list[str]:
    """List the problems that FMPy finds in an FMU."""
    from fmpy.validation import validate_fmu  # noqa: PLC0415 - an extra

    return [str(problem) for problem in validate_fmu(str(path))]


def _bench_lines(config: BenchConfig, axis: AxisConfig) -> Iterator[str]:
    """Yield the lines of a bench that has this axis and its supply alone, as they were given."""
    supply, axes = find_supply(config, axis), axes_with(config, axis)
    yield "[bench]"
    yield f"tick_us = {config.tick_ns // 1000}"
    yield f"step_us = {config.step_ns // 1000}"
    tables = [] if supply is None else [f"supply.{supply.name}"]
    for table in (*tables, *(f"plant.{each.name}" for each in axes)):
        yield f"\n[{table}]"
        for setting in config.settings:
            if setting.table == table and setting.origin in _GIVEN:
                yield f"{setting.key.name} = {json.dumps(setting.value)}"
    for number, each in enumerate(axes, 1):
        yield f'\n[nodes.valve{number}]\nprofile = "valve_408"\naxis = "{each.name}"'
        yield f"node_id = {number}"
    yield ""
