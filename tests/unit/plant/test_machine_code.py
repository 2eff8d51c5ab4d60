import importlib.util
import math
import subprocess
import sys
from inspect import unwrap
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from hil_bench.errors import ParameterError
from hil_bench.plants.hydraulic_cylinder.cylinder import CylinderGroup, FullOrderCylinder
from hil_bench.plants.hydraulic_cylinder.model import (
    FullOrderPlant,
    PlantInput,
    PlantOptions,
    ReducedOrderPlant,
    full_order,
    machine_code,
    moving,
    paper_parameters,
    reduced_order,
    side_by_side,
)
from hil_bench.plants.hydraulic_cylinder.model.defects import Defects
from hil_bench.plants.hydraulic_cylinder.model.machine_code import (
    MachineCode,
    examine,
    find_machine_code,
    fingerprint,
)
from hil_bench.plants.hydraulic_cylinder.model.moving import describe_kernels
from hil_bench.plants.hydraulic_cylinder.model.supply import AS_GIVEN, OilNow

ROOT = Path(__file__).parents[3]
CARRIED = find_machine_code().bind is not None
KERNELS = [
    *full_order._ADVANCE.values(),
    full_order.advance_lined_midpoint,
    *reduced_order._ADVANCE.values(),
    side_by_side.move_group,
]


@pytest.fixture
def sources(tmp_path):
    folder = tmp_path / "model"
    folder.mkdir()
    (folder / "orifice.py").write_text("C_d = 0.6\n")
    return folder


@pytest.fixture
def extension(monkeypatch, sources):
    """An extension module of these sources, whose kernels nobody calls."""
    module = ModuleType("kernels_of_a_wheel")
    module.SOURCES, module.COMPILER, module.LEVEL = fingerprint(sources), "Numba 0.68.1", "x86-64"
    module.missing_instructions = list
    module.bind = lambda *_: None
    monkeypatch.setitem(sys.modules, module.__name__, module)
    return module


def test_what_fits_is_used(extension, sources):
    found = examine(extension.__name__, sources)

    assert found == MachineCode(extension.bind, "Numba 0.68.1", "x86-64")
    assert str(found) == "compiled ahead of time by Numba 0.68.1 for x86-64"


def test_a_wheel_without_kernels_is_nothing_to_speak_of(sources):
    assert examine(f"{machine_code.__package__}.nowhere", sources) == MachineCode()


def test_an_edited_source_is_not_run_as_it_was(extension, sources):
    (sources / "orifice.py").write_text("C_d = 0.7\n")

    found = examine(extension.__name__, sources)

    assert found.bind is None
    assert found.refusal == f"{sources} was edited after they were compiled"


def test_a_processor_without_the_instructions_is_said(extension, sources):
    extension.missing_instructions = lambda: ["bmi2", "avx2"]

    found = examine(extension.__name__, sources)

    assert (found.bind, found.refusal) == (None, "this processor has no bmi2, avx2")


def test_an_extension_that_does_not_load_is_said(sources, monkeypatch):
    (sources / "kernels_amiss.py").write_text("raise ImportError('undefined symbol: exp')")
    monkeypatch.syspath_prepend(sources)

    found = examine("kernels_amiss", sources)

    assert (found.bind, found.refusal) == (None, "they do not load: undefined symbol: exp")


@pytest.mark.parametrize("change", ["content", "name", "more"])
def test_each_change_of_the_sources_shows(sources, change):
    before, file = fingerprint(sources), sources / "orifice.py"
    match change:
        case "content":
            file.write_text("C_d = 0.8\n")
        case "name":
            file.rename(sources / "spool.py")
        case _:
            (sources / "lands.py").touch()

    assert fingerprint(sources) != before


def test_a_copy_of_the_sources_is_the_same(sources, tmp_path):
    copy = tmp_path / "site-packages"
    copy.mkdir()
    (copy / "orifice.py").write_text((sources / "orifice.py").read_text())

    assert fingerprint(copy) == fingerprint(sources)


def test_who_wants_python_gets_no_machine_code(monkeypatch):
    monkeypatch.setattr(machine_code, "WANTS_PYTHON", True)
    monkeypatch.setattr(machine_code, "examine", lambda *_: MachineCode(len))
    find_machine_code.cache_clear()
    try:
        assert find_machine_code() == MachineCode()
    finally:
        find_machine_code.cache_clear()


@pytest.mark.parametrize(
    ("carried", "has_numba", "described"),
    [
        (
            MachineCode(len, "Numba 1", "x86-64"),
            True,
            "compiled ahead of time by Numba 1 for x86-64",
        ),
        (MachineCode(), True, "compiled by Numba"),
        (MachineCode(), False, "interpreted"),
        (
            MachineCode(refusal="this processor has no avx2"),
            True,
            "compiled by Numba; those of the wheel are not used: this processor has no avx2",
        ),
    ],
)
def test_what_runs_is_described(monkeypatch, carried, has_numba, described):
    monkeypatch.setattr(moving, "find_machine_code", lambda: carried)
    monkeypatch.setattr(moving, "IS_COMPILED", has_numba)

    assert describe_kernels() == described


def test_the_build_compiles_each_kernel_that_a_plant_runs():
    spec = importlib.util.spec_from_file_location("compile_kernels", ROOT / "kernels/compile.py")
    program = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(program)

    compiled = {path.partition(".")[2] for path in (*program.ADVANCES, program.GROUP)}
    assert compiled == {kernel.__name__ for kernel in KERNELS}


def bind_sources(name, *rows):
    """What the extension's function does, by the kernels' sources as they stand."""
    (kernel,) = {kernel for kernel in KERNELS if kernel.__name__ == name}

    def move(*values):
        seen = unwrap(kernel)(*rows, *values)
        if name != "move_group" and not math.isfinite(sum(seen[:4])):
            raise FloatingPointError
        return seen

    return move


@pytest.fixture
def as_carried(monkeypatch):
    """Have plants run as where a wheel carries their kernels."""
    carried = SimpleNamespace(bind=bind_sources)
    return lambda: monkeypatch.setattr(moving, "find_machine_code", lambda: carried)


def run_full():
    plant = FullOrderPlant(paper_parameters())
    seen = [plant.step(PlantInput(1e-3, 5e3), 5)]
    plant.supply_pressure = 9e6
    plant.warm(OilNow(2.0, 0.98, 0.9))
    seen.append(plant.step(PlantInput(1e-3, 5e3), 5))
    plant.defects = Defects(leakage_a=1e-12)  # from here on it is extended
    seen.append(plant.step(PlantInput(-1e-3), 5))
    plant.warm(AS_GIVEN)
    plant.restart(plant.state._replace(v=0.1))
    return [*seen, plant.step(PlantInput(-1e-3), 5), plant.state, plant.extension]


def run_reduced():
    plant = ReducedOrderPlant(paper_parameters(), options=PlantOptions.bench())
    plant.supply_pressure = 9e6
    return [plant.step(PlantInput(1e-3, 5e3), 5), plant.state]


def run_group():
    cylinders = [FullOrderCylinder(paper_parameters()) for _ in range(4)]
    group = CylinderGroup(cylinders)
    seen = [list(map(list, group.drive([1e-3, -1e-3, 5e-4, 0.0], 3)))]
    cylinders[1].influence("leakage_a", 1e-12)  # moves by itself from here on
    cylinders[0].restart(cylinders[0].state._replace(v=0.1))
    seen.append(list(map(list, group.drive([1e-3, -1e-3, 5e-4, 0.0], 3))))
    for cylinder in cylinders[2:]:
        cylinder.influence("leakage_a", 1e-12)
    return [*seen, list(map(list, group.drive([1e-3] * 4, 3))), [each.state for each in cylinders]]


@pytest.mark.parametrize("run", [run_full, run_reduced, run_group])
def test_a_plant_whose_kernels_are_carried_is_the_same_plant(as_carried, run):
    before = run()
    as_carried()

    assert run() == before


def test_a_carried_kernel_that_diverges_is_refused(as_carried):
    as_carried()
    plant = FullOrderCylinder(paper_parameters())
    plant._state[1] = math.nan

    for move in (plant.drive, lambda u, steps: plant.step(PlantInput(u), steps)):
        with pytest.raises(ParameterError, match="has diverged"):
            move(1e-4, 20)


BUILD_AND_LIST = """
import sys
from hil_bench.cli import main
from hil_bench.plants.hydraulic_cylinder.model import *
FullOrderPlant(paper_parameters()).sensed_pressure
ReducedOrderPlant(paper_parameters())
code = main(["demo", "--speed", "max", "--duration", "0.1", "--output", sys.argv[1]])
print(code, sorted({"numba"} & set(sys.modules)))
"""


@pytest.mark.skipif(not CARRIED, reason="this installation carries no kernels")
def test_a_bench_with_carried_kernels_needs_no_numba(tmp_path):
    command = [sys.executable, "-c", BUILD_AND_LIST, str(tmp_path / "output")]
    done = subprocess.run(command, check=True, capture_output=True, text=True)  # noqa: S603 - above

    assert done.stdout.splitlines()[-1] == "0 []"


@pytest.mark.skipif(not CARRIED, reason="this installation carries no kernels")
@pytest.mark.parametrize(
    "call",
    [
        lambda bind, row: bind("advance_nowhere", row, row),
        lambda bind, row: bind("advance_implicit_midpoint", row),
        lambda bind, _: bind("advance_implicit_midpoint", [0.0], [0.0]),
        lambda bind, _: bind("advance_implicit_midpoint", bytearray(8), bytearray(8)),
        lambda bind, row: bind("advance_implicit_midpoint", row, row)(0.0, 0.0),
        lambda bind, row: bind("advance_implicit_midpoint", row, row)("1", 0.0, 1),
        lambda bind, row: bind("advance_implicit_midpoint", row, row)(0.0, 0.0, steps=1),
        lambda bind, _: bind(),
    ],
)
def test_a_wrong_call_of_a_carried_kernel_is_refused(call):
    row = moving.make_plant_row([0.0] * 64)

    with pytest.raises((TypeError, ValueError, BufferError)):
        call(find_machine_code().bind, row)
