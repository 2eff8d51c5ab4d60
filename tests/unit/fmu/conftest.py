"""A bench whose axis is the slider of `support/slider.c`: x' = 0.5 mm/s times the command."""

from collections.abc import Callable

import pytest
from support.fmus import CAN_BUILD, write_fmu

from hil_bench.bench.configuration import BenchConfig, load_config

Load = Callable[..., BenchConfig]

PLANT = {
    "file": '"slider.fmu"',
    "command": '"u"',
    "full_command": "100.0",
    "outputs": '{ position = "x", speed = "v" }',
    "inputs": '{ load = "F" }',
}
NODES = """
[nodes]
valve = { profile = "valve_408", node_id = 1 }
position = { profile = "encoder_406", node_id = 4 }
"""


def bench_text(keys, bench="step_us = 1000"):
    lines = (f"{key} = {value}" for key, value in (PLANT | keys).items() if value is not None)
    return f'[bench]\n{bench}\n[plant.axis1]\nkind = "fmu"\n' + "\n".join(lines) + "\n" + NODES


@pytest.fixture
def load(tmp_path):
    if not CAN_BUILD:
        pytest.skip("needs gcc and fmpy")

    def read(version=2, *, bench="step_us = 1000", description="", **keys):
        if not (tmp_path / "slider.fmu").exists():
            write_fmu(tmp_path / "slider.fmu", version, description)
        (tmp_path / "bench.toml").write_text(bench_text(keys, bench))
        return load_config(tmp_path / "bench.toml")

    return read
