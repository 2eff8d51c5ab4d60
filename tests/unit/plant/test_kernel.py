import os
import subprocess
import sys
from pathlib import Path

import pytest

import hil_bench.plants
from hil_bench.errors import HilBenchError
from hil_bench.plants.hydraulic_cylinder.model.implicit_midpoint import advance_implicit_midpoint
from hil_bench.plants.hydraulic_cylinder.model.kernel import (
    IS_COMPILED,
    _has_place,
    digest_of_sources,
    kernel,
    ready,
)

RUN_AND_PRINT_BITS = """
import dataclasses
import random
import sys
steps, *missing = sys.argv[1:]
sys.modules.update({name: None for name in missing})  # None: as if not installed
from hil_bench.plants.hydraulic_cylinder.model import *
extended = PlantOptions(
    end_stop=EndStop(),
    cavitation_floor=-101325.0,
    C_LA=1e-12,
    air=EntrainedAir(air_fraction=0.01),
    bristles=LuGreFriction(),
    supply=SupplyUnit(),
    loads=(SpringLoad(1e4), LoadSeries((0.1, 0.4, 0.9), (0.0, 9e3, -5e3))),
)
for solver in Solver:
    for options in (PlantOptions.paper(), PlantOptions.bench(), extended):
        plant = FullOrderPlant(paper_parameters(), options=options, solver=solver, dt=2e-5)
        source = random.Random(1)
        for _ in range(int(steps)):
            plant.step(PlantInput(source.uniform(-2e-3, 2e-3), source.uniform(-6e4, 6e4)), 25)
        *extension, waves = plant.extension
        print(*(value.hex() for value in (*plant.state, *plant.output, *extension, *waves)))
        print(plant.extra_evaluations)
    loads = (SpringLoad(1e4), LoadSeries((0.1, 0.4, 0.9), (0.0, 9e3, -5e3)))
    options = dataclasses.replace(PlantOptions.bench(), loads=loads)
    reduced = ReducedOrderPlant(
        paper_parameters(), options=options, solver=solver, dt=2e-5, delay=5e-4
    )
    source = random.Random(1)
    for _ in range(int(steps)):
        reduced.step(PlantInput(source.uniform(-2e-3, 2e-3), source.uniform(-6e4, 6e4)), 25)
    print(*(value.hex() for value in reduced.output))
    print(reduced.extra_evaluations)
"""


def run_plants(steps, disable_jit, *missing):
    command = [sys.executable, "-c", RUN_AND_PRINT_BITS, str(steps), *missing]
    environment = {**os.environ, "NUMBA_DISABLE_JIT": disable_jit}
    finished = subprocess.run(  # noqa: S603 - the script above
        command, env=environment, check=True, capture_output=True, text=True
    )
    return finished.stdout


@pytest.mark.long
@pytest.mark.skipif(not IS_COMPILED, reason="Numba is missing or disabled: nothing to compare")
def test_compiled_and_interpreted_plant_agree_to_the_bit():
    """One second through free motion, both stops, cavitation and overload."""
    compiled = run_plants(400, "0")
    assert compiled.count("\n") == 24
    in_parts = [int(line) for line in compiled.splitlines()[1::2]]
    assert [count > 0 for count in in_parts] == [False] * 4 + [True] * 4 + [False] * 4  # by solver
    assert compiled == run_plants(400, "1")


@pytest.mark.long
@pytest.mark.skipif(not IS_COMPILED, reason="Numba is missing or disabled: nothing to compare")
def test_without_numba_the_plant_is_interpreted():
    assert run_plants(20, "0", "numba") == run_plants(20, "0")


@pytest.mark.skipif(not IS_COMPILED, reason="Numba is missing or disabled: nothing to load")
def test_numba_that_does_not_run_is_named(monkeypatch):
    """As where NumPy is newer than Numba allows: Numba is found, and its import fails."""
    monkeypatch.setitem(sys.modules, "numba", None)
    late = kernel(lambda x: x)
    with pytest.raises(
        HilBenchError, match=r"Numba is there but does not run.*NUMBA_DISABLE_JIT=1"
    ):
        late(1.0)


@pytest.mark.skipif(not IS_COMPILED, reason="Numba is missing or disabled: nothing is cached")
def test_machine_code_is_cached_by_the_sources_of_all_plants():
    """A kernel that calls into an edited file would be stale: Numba looks at its own file only."""
    statistics = ready(advance_implicit_midpoint).stats
    plants = Path(hil_bench.plants.__file__).parent
    assert f"kernels-{digest_of_sources(plants)}" in statistics.cache_path


@pytest.mark.usefixtures("no_home")
@pytest.mark.parametrize(
    ("cache", "folder", "has"),
    [
        (None, "", False),
        (None, "file/kernels", False),
        (None, "kernels", True),
        ("", "", False),
        ("here", "", False),
        ("/there", "", True),
    ],
)
def test_no_machine_code_is_taken_from_the_present_folder(
    tmp_path, monkeypatch, cache, folder, has
):
    """Numba keeps it in the folder "~" of the present one where there is no home."""
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    if cache is not None:
        monkeypatch.setenv("XDG_CACHE_HOME", cache)
    (tmp_path / "file").touch()
    assert _has_place.__wrapped__(str(tmp_path / folder) if folder else "") is has


COMPILE_AND_LOG = """
import logging
logging.basicConfig(level=logging.INFO, format="%(message)s")
from hil_bench.plants.hydraulic_cylinder.model.elementary import log, split
split(8.0)
log(8.0)
"""


@pytest.mark.long
@pytest.mark.skipif(not IS_COMPILED, reason="Numba is missing or disabled: nothing is compiled")
def test_what_is_compiled_is_said_once_and_not_again_where_it_is_cached(tmp_path):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    said = [
        subprocess.run(  # noqa: S603 - the script above
            [sys.executable, "-c", COMPILE_AND_LOG],
            env=environment,
            check=True,
            capture_output=True,
            text=True,
        ).stderr
        for _ in range(2)
    ]
    (kernels,) = tmp_path.iterdir()
    later = f"later starts load them from {kernels}"
    assert said == [f"compiling the plant's kernels for this processor; {later}\n", ""]


@pytest.mark.parametrize("change", ["text", "time", "name", "new"])
def test_any_change_of_the_sources_has_a_cache_of_its_own(tmp_path, change):
    inner = tmp_path / "model"
    inner.mkdir()
    source = inner / "orifice.py"
    source.write_text("C_d = 0.6")
    os.utime(source, ns=(10**18, 10**18))
    before = digest_of_sources(tmp_path)
    assert digest_of_sources(tmp_path) == before
    match change:
        case "text":
            source.write_text("C_d = 0.65")
            os.utime(source, ns=(10**18, 10**18))
        case "time":
            os.utime(source, ns=(10**18, 10**18 + 1000))
        case "name":
            source.rename(inner / "edges.py")
        case _:
            (inner / "more.py").touch()
    assert digest_of_sources(tmp_path) != before
