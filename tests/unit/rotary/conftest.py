"""A motor of round numbers, built from a file as users build theirs."""

import pytest
from support.motors import LOSSLESS, STEP, write_bench

from hil_bench.bench.configuration import load_config
from hil_bench.plants.rotary.configuration import RotaryConfig
from hil_bench.plants.rotary.kind import HydraulicMotor


@pytest.fixture
def motor(tmp_path):
    def build(**keys):
        config = load_config(write_bench(tmp_path, LOSSLESS | keys))
        (axis,) = config.axes
        assert isinstance(axis, RotaryConfig)
        return axis, HydraulicMotor(axis, STEP, {})

    return build
